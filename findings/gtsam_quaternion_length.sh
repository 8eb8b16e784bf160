#!/usr/bin/env bash
# A quaternion with rounded numbers shortens what it turns in gtsam and in pycolmap.
#
# Version: gtsam 4.3.0, pycolmap 4.2.1, scipy 1.17.1, numpy 2.4.6, Python 3.11.
# Expected: files of trajectories often have few digits, and a type for rotations normalizes what it is given, as that
#   of scipy does, or refuses it.
# Behaviour: both put the numbers into the formula for unit quaternions. The matrix is no rotation, products keep the
#   error, and nothing is said. pycolmap has normalize(), which is not called.
# Output (length of the x axis after a quarter turn about z, written as 0.7 0 0 0.7):
#   scipy: 1.0
#   gtsam: 0.98
#   pycolmap: 0.98
# Remedy: normalize before making a rotation.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check gtsam==4.3.0 pycolmap==4.2.1 scipy==1.17.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import gtsam
import numpy as np
import pycolmap
from scipy.spatial.transform import Rotation

axis = np.array([1.0, 0.0, 0.0])
turned = {
    "scipy": Rotation.from_quat([0.0, 0.0, 0.7, 0.7]).apply(axis),
    "gtsam": gtsam.Rot3.Quaternion(0.7, 0.0, 0.0, 0.7).rotate(axis),
    "pycolmap": pycolmap.Rotation3d(np.array([0.0, 0.0, 0.7, 0.7])) * axis,
}
seen = {name: round(float(np.linalg.norm(vector)), 3) for name, vector in turned.items()}
for name, length in seen.items():
    print(f"{name}: {length}")
raise SystemExit(0 if seen == {"scipy": 1.0, "gtsam": 0.98, "pycolmap": 0.98} else "the behaviour has changed")
PYTHON
