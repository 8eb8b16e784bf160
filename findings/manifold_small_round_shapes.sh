#!/usr/bin/env bash
# Of a ball with a radius of 5 cm, manifold3d makes an octahedron with a third of the volume.
#
# Version: manifold3d 3.5.4, numpy 2.4.6, Python 3.11.
# Expected: Manifold.sphere(radius) and Manifold.cylinder are round to some percent whatever the unit is, as each length
#   is just a number.
# Behaviour: the number of segments comes from the radius as well as from the angle, with edges no shorter than one. In
#   metres the objects of a table have four segments, in millimetres they are round.
# Output (volume, as a part of the exact one):
#   radius 0.05: ball 0.32, cylinder 0.64
#   radius 1: ball 0.70, cylinder 0.90
#   radius 50: ball 0.98, cylinder 0.99
# Remedy: give circular_segments, or set_min_circular_edge_length once.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check manifold3d==3.5.4 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import math

from manifold3d import Manifold

seen = {}
for radius in (0.05, 1.0, 50.0):
    ball = Manifold.sphere(radius).volume() / (4.0 / 3.0 * math.pi * radius**3)
    cylinder = Manifold.cylinder(radius, radius).volume() / (math.pi * radius**3)
    seen[radius] = [round(ball, 2), round(cylinder, 2)]
for radius, (ball, cylinder) in seen.items():
    print(f"radius {radius:g}: ball {ball:.2f}, cylinder {cylinder:.2f}")
expected = {0.05: [0.32, 0.64], 1.0: [0.70, 0.90], 50.0: [0.98, 0.99]}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
