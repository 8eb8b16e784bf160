#!/usr/bin/env bash
# The logarithm of spatialmath loses up to a tenth of a degree for rotations near half a turn.
#
# Version: spatialmath-python 1.1.18, scipy 1.17.1, numpy 2.4.6, Python 3.11.
# Expected: exp and log come back to the rotation to about 1e-8 rad at worst, as with scipy.
# Behaviour: within 20 eps of a trace of -1 a formula for exactly half a turn is used; before that one divides by a sine
#   that is mostly rounding. 1e-7 rad before half a turn the rotation comes back more than 1e-3 rad off, which is a
#   tenth of a degree.
# Output (angle between a rotation and exp(log) of it):
#   0.1 rad before half a turn: spatialmath below 1e-8, scipy below 1e-8
#   1e-07 rad before half a turn: spatialmath above 1e-3, scipy below 1e-8
#   0.0 rad before half a turn: spatialmath below 1e-8, scipy below 1e-8
# Remedy: take the logarithm through a quaternion, for instance scipy's Rotation.as_rotvec.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check spatialmath-python==1.1.18 scipy==1.17.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
import spatialmath.base
from scipy.spatial.transform import Rotation


def size(vector, rotation):
    """How far the rotation of this vector is from a rotation."""
    angle = (Rotation.from_rotvec(vector).inv() * rotation).magnitude()
    return "below 1e-8" if angle < 1e-8 else "above 1e-3" if angle > 1e-3 else "between"


axis = np.array([1.0, 2.0, -3.0]) / np.sqrt(14.0)
seen = {}
for before in (0.1, 1e-7, 0.0):
    rotation = Rotation.from_rotvec((np.pi - before) * axis)
    by_matrix = spatialmath.base.trlog(rotation.as_matrix(), twist=True)
    seen[before] = [size(by_matrix, rotation), size(rotation.as_rotvec(), rotation)]
for before, (first, second) in seen.items():
    print(f"{before} rad before half a turn: spatialmath {first}, scipy {second}")
small = "below 1e-8"
expected = {0.1: [small, small], 1e-7: ["above 1e-3", small], 0.0: [small, small]}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
