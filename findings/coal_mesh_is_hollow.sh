#!/usr/bin/env bash
# For coal a closed triangle mesh is a surface: what is wholly inside it does not touch it.
#
# Version: coal 3.0.3 (the collision library of Pinocchio), numpy 2.4.6, Python 3.11.
# Expected: a box made of 12 triangles and coal.Box of the same size answer alike.
# Behaviour: a ball in the middle of the mesh is 0.4 m away from it and free; in the middle of the Box it is 0.6 m
#   deep. Two meshes that overlap by 0.5 m have a distance of 0, not -0.5, so that depth is no measure of what is
#   worse.
# Output:
#   ball inside: mesh +0.4 (contacts 0), box -0.6 (contacts 1)
#   overlap of 0.5 m: two meshes +0.0, two boxes -0.5
# Remedy: convex pieces (coal.Convex) or primitives wherever inside and depth matter; URDF files load meshes as
#   surfaces.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check coal==3.0.3 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import coal
import numpy as np


def at(x):
    """A pose that is moved along x only."""
    return coal.Transform3s(np.eye(3), np.array([x, 0.0, 0.0]))


def distance(one, other, x):
    """Signed distance of two shapes, the second moved along x."""
    return round(coal.distance(one, at(0.0), other, at(x), coal.DistanceRequest(True), coal.DistanceResult()), 3) + 0.0


def contacts(one, other):
    """Number of contacts of two shapes in the same place."""
    return coal.collide(one, at(0.0), other, at(0.0), coal.CollisionRequest(), coal.CollisionResult())


corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
mesh = coal.BVHModelOBBRSS()
mesh.beginModel(12, 8)
for a, b, c, d in quads:
    mesh.addTriangle(corners[a], corners[b], corners[c])
    mesh.addTriangle(corners[a], corners[c], corners[d])
mesh.endModel()
box, ball = coal.Box(1.0, 1.0, 1.0), coal.Sphere(0.1)
inside = [(distance(shape, ball, 0.0), contacts(shape, ball)) for shape in (mesh, box)]
overlap = [distance(mesh, mesh, 0.5), distance(box, box, 0.5)]
print("ball inside: mesh {:+} (contacts {}), box {:+} (contacts {})".format(*inside[0], *inside[1]))
print("overlap of 0.5 m: two meshes {:+}, two boxes {:+}".format(*overlap))
same = inside == [(0.4, 0), (-0.6, 1)] and overlap == [0.0, -0.5]
raise SystemExit(0 if same else "the behaviour has changed")
PYTHON
