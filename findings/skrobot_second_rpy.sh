#!/usr/bin/env bash
# The second set of angles that scikit-robot gives for a quaternion is not the same rotation.
#
# Version: scikit-robot 0.4.7, scipy 1.17.1, numpy 2.4.6, Python 3.11.
# Expected: quaternion2rpy gives two triples of yaw, pitch and roll for one rotation, so that the nearer one can be
#   used.
# Behaviour: the second triple is pi minus each angle. Yaw and roll would have to be pi plus the angle, so it is some
#   other rotation, here one 34 degrees away.
# Output (angle from the rotation to the one of each triple, in degrees):
#   first: 0.0
#   second: 34.0
# Remedy: take the first triple only; the other one is (pi + yaw, pi - pitch, pi + roll).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check scikit-robot==0.4.7 scipy==1.17.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
from scipy.spatial.transform import Rotation
from skrobot.coordinates.math import matrix2quaternion, quaternion2rpy


def away(triple):
    """Angle in degrees from the rotation to the one of these angles."""
    other = Rotation.from_euler("ZYX", triple)
    return round(float(np.degrees((rotation.inv() * other).magnitude())), 1)


rotation = Rotation.from_euler("ZYX", [0.1, 0.2, 0.3])
first, second = quaternion2rpy(matrix2quaternion(rotation.as_matrix()))
yaw, pitch, roll = first
assert away([np.pi + yaw, np.pi - pitch, np.pi + roll]) == 0.0
seen = {"first": away(first), "second": away(second)}
for name, angle in seen.items():
    print(f"{name}: {angle}")
raise SystemExit(0 if seen == {"first": 0.0, "second": 34.0} else "the behaviour has changed")
PYTHON
