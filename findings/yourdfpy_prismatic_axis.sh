#!/usr/bin/env bash
# The same URDF slides twice as far in yourdfpy as in Pinocchio when an axis has the length 2.
#
# Version: yourdfpy 0.0.60, pin 4.1.0, numpy 2.4.6, Python 3.11.
# Expected: only the direction of an axis counts. The URDF page says that it should be normalized, and files exported
#   by programs are often not exactly so; revolute joints take any length.
# Behaviour: for prismatic joints yourdfpy multiplies the position by the axis as it is written. Pinocchio normalizes
#   it.
# Output (position of the tip at 0.5):
#   prismatic, axis 0 0 1: Pinocchio 0.5, yourdfpy 0.5
#   prismatic, axis 0 0 2: Pinocchio 0.5, yourdfpy 1.0
# Remedy: normalize the axes of a file before several programs read it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check yourdfpy==0.0.60 trimesh==5.2.0 numpy==2.4.6 pin==4.1.0
"$folder/venv/bin/python" - <<'PYTHON'
import io

import numpy as np
import pinocchio
import yourdfpy

text = """<robot name="slide"><link name="base"/><link name="tip"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="tip"/><axis xyz="0 0 {}"/>
<limit lower="-1" upper="1" effort="20" velocity="1"/></joint></robot>"""


def heights(length):
    """Height of the tip at 0.5 by Pinocchio and by yourdfpy."""
    model = pinocchio.buildModelFromXML(text.format(length))
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.array([0.5]))
    robot = yourdfpy.URDF.load(io.BytesIO(text.format(length).encode()), load_meshes=False)
    robot.update_cfg([0.5])
    frame = data.oMf[model.getFrameId("tip")]
    return [round(float(frame.translation[2]), 6), round(float(robot.get_transform("tip")[2, 3]), 6)]


seen = {length: heights(length) for length in (1, 2)}
for length, (first, second) in seen.items():
    print(f"prismatic, axis 0 0 {length}: Pinocchio {first}, yourdfpy {second}")
raise SystemExit(0 if seen == {1: [0.5, 0.5], 2: [0.5, 1.0]} else "the behaviour has changed")
PYTHON
