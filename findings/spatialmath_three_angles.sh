#!/usr/bin/env bash
# Three functions of spatialmath give three angles between the same two rotations.
#
# Version: spatialmath-python 1.1.18, scipy 1.17.1, numpy 2.4.6, Python 3.11.
# Expected: the default of SO3.angdist, the default of UnitQuaternion.angdist and base.qangle are the angle of the
#   rotation from one to the other. The page of qangle says that it is the smallest.
# Behaviour: UnitQuaternion.angdist gives half of it, as it measures between the quaternions. qangle gives the long way
#   round if the scalar product is negative, so the sign of a quaternion, which means nothing, decides.
# Output (a rotation by 2 rad; with q and -q):
#   SO3.angdist: 2.0
#   UnitQuaternion.angdist: 1.0 1.0
#   qangle: 2.0 4.283
# Remedy: UnitQuaternion.angdist with metric=4, or the angle through SO3.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check spatialmath-python==1.1.18 scipy==1.17.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
from spatialmath import SO3, UnitQuaternion
from spatialmath.base import qangle

one = np.array([1.0, 0.0, 0.0, 0.0])
other = np.array([np.cos(1.0), 0.0, 0.0, np.sin(1.0)])
seen = {
    "SO3.angdist": [SO3().angdist(SO3.Rz(2.0))],
    "UnitQuaternion.angdist": [UnitQuaternion(one).angdist(UnitQuaternion(sign * other)) for sign in (1, -1)],
    "qangle": [qangle(one, sign * other) for sign in (1, -1)],
}
seen = {name: [round(float(angle), 3) for angle in angles] for name, angles in seen.items()}
for name, angles in seen.items():
    print(f"{name}: {' '.join(map(str, angles))}")
expected = {"SO3.angdist": [2.0], "UnitQuaternion.angdist": [1.0, 1.0], "qangle": [2.0, 4.283]}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
