#!/usr/bin/env bash
# The mean of two rotations by one degree is half a turn in numpy-quaternion if one of them has the other sign.
#
# Version: numpy-quaternion 2024.0.13, scipy 1.17.1, numpy 2.4.6, Python 3.11.
# Expected: a mean of rotors in the chordal metric is a mean of rotations, as scipy's; q and -q are one rotation, and
#   cameras and matrices give either.
# Behaviour: the quaternions are added up as they are. Opposite signs cancel, and what is left of the noise is
#   normalized. Nothing is raised. The same holds for optimal_alignment_in_chordal_metric, which calls it.
# Output (angle of the mean of turns by -1 and +1 degree about z, in degrees):
#   equal signs: quaternion 0.0, scipy 0.0
#   opposite signs: quaternion 180.0, scipy 0.0
# Remedy: turn the signs to that of the first one before averaging, or scipy's Rotation.mean.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check numpy-quaternion==2024.0.13 scipy==1.17.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
import quaternion
from scipy.spatial.transform import Rotation

half = np.radians(0.5)
one = np.array([np.cos(half), 0.0, 0.0, -np.sin(half)])
other = np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
seen = {}
for name, sign in (("equal signs", 1.0), ("opposite signs", -1.0)):
    rotors = np.array([one, sign * other])
    first = quaternion.mean_rotor_in_chordal_metric(quaternion.from_float_array(rotors))
    second = Rotation.from_quat(rotors[:, [1, 2, 3, 0]]).mean()
    angles = 2.0 * np.arccos(min(1.0, abs(first.w))), second.magnitude()
    seen[name] = [round(float(np.degrees(angle)), 1) for angle in angles]
for name, (first, second) in seen.items():
    print(f"{name}: quaternion {first}, scipy {second}")
expected = {"equal signs": [0.0, 0.0], "opposite signs": [180.0, 0.0]}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
