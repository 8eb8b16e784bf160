#!/usr/bin/env bash
# The principal axes that trimesh gives are a reflection for about half of all orientations of a body.
#
# Version: trimesh 5.2.0, scipy 1.17.1, numpy 2.4.6, Python 3.11.
# Expected: principal_inertia_vectors, put together, are a rotation, as the orientation of an inertia in URDF or MJCF
#   has to be.
# Behaviour: the vectors come as the decomposition leaves them. The determinant is 1 or -1, and flips when the body is
#   turned a little. A conversion to a quaternion makes some other rotation of it, often without an error.
#   principal_inertia_transform is always a rotation.
# Output (a box of 1 x 2 x 3 in 40 orientations):
#   both signs of the determinant: True
#   principal_inertia_transform always a rotation: True
# Remedy: principal_inertia_transform, or turn one axis round where the determinant is negative.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check trimesh==5.2.0 scipy==1.17.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

signs, rotations = set(), set()
for rotation in Rotation.random(40, random_state=0):
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    pose = np.eye(4)
    pose[:3, :3] = rotation.as_matrix()
    box.apply_transform(pose)
    signs.add(round(float(np.linalg.det(box.principal_inertia_vectors))))
    rotations.add(round(float(np.linalg.det(box.principal_inertia_transform[:3, :3]))))
seen = [signs == {-1, 1}, rotations == {1}]
print(f"both signs of the determinant: {seen[0]}")
print(f"principal_inertia_transform always a rotation: {seen[1]}")
raise SystemExit(0 if seen == [True, True] else "the behaviour has changed")
PYTHON
