#!/usr/bin/env bash
# In ikpy a revolute joint whose axis is not of length one stretches everything behind it.
#
# Version: ikpy 4.2.1, numpy 2.4.6, Python 3.11.
# Expected: the axis gives a direction and is normalized, as by Pinocchio, MuJoCo and yourdfpy. Files of programs write
#   axes such as 0.577 0.577 0.577 or 0 0 -3.
# Behaviour: the formula for unit axes is used as it is. The matrix of the link is no rotation, its determinant depends
#   on the angle, and inverse kinematics search with it.
# Output (determinant of the tip's rotation at 0, 1 and 2 rad):
#   axis 0 0 1: 1.0 1.0 1.0
#   axis 0 0 2: 1.0 7.433 18.267
# Remedy: normalize the axes of a file before ikpy reads it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check ikpy==4.2.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import pathlib
import tempfile
import warnings

import numpy as np
from ikpy.chain import Chain

warnings.simplefilter("ignore")
text = """<robot name="arm"><link name="base"/><link name="tip"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 {}"/>
<limit lower="-3" upper="3" effort="20" velocity="1"/></joint></robot>"""
seen = {}
with tempfile.TemporaryDirectory() as folder:
    for length in (1, 2):
        path = pathlib.Path(folder, "arm.urdf")
        path.write_text(text.format(length))
        chain = Chain.from_urdf_file(str(path), base_elements=["base"])
        poses = [chain.forward_kinematics([0.0, angle]) for angle in (0.0, 1.0, 2.0)]
        seen[length] = [round(float(np.linalg.det(pose[:3, :3])), 3) for pose in poses]
for length, determinants in seen.items():
    print(f"axis 0 0 {length}: {' '.join(map(str, determinants))}")
raise SystemExit(0 if seen == {1: [1.0, 1.0, 1.0], 2: [1.0, 7.433, 18.267]} else "the behaviour has changed")
PYTHON
