#!/usr/bin/env bash
# In USD's Gf the product a * b turns by a first for rotations and matrices, and by b first for their quaternions.
#
# Version: usd-core 26.11, Python 3.11.
# Expected: a product of rotations, written with the same two factors in the same order, is the same turn in every type
#   of one library.
# Behaviour: Gf.Rotation and Gf.Matrix3d act on rows, so a * b is a, then b. Gf.Quatd multiplies as everywhere, which is
#   b, then a. Changing the type in a line of code exchanges the order.
# Output (the x axis, turned by "a quarter about z" * "a quarter about x"):
#   Rotation: 0 0 1
#   Matrix3d: 0 0 1
#   Quatd: 0 1 0
# Remedy: exchange the factors when a formula moves between quaternions and the other two.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check usd-core==26.11 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
from pxr import Gf

about_z = Gf.Rotation(Gf.Vec3d(0, 0, 1), 90.0)
about_x = Gf.Rotation(Gf.Vec3d(1, 0, 0), 90.0)
axis = Gf.Vec3d(1, 0, 0)
turned = {
    "Rotation": (about_z * about_x).TransformDir(axis),
    "Matrix3d": axis * (Gf.Matrix3d(about_z) * Gf.Matrix3d(about_x)),
    "Quatd": (about_z.GetQuat() * about_x.GetQuat()).Transform(axis),
}
seen = {name: [round(number) for number in vector] for name, vector in turned.items()}
for name, vector in seen.items():
    print(f"{name}: {' '.join(map(str, vector))}")
expected = {"Rotation": [0, 0, 1], "Matrix3d": [0, 0, 1], "Quatd": [0, 1, 0]}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
