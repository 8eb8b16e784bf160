#!/usr/bin/env bash
# From a MJCF axisangle whose axis is not of length one, Pinocchio makes a matrix that is no rotation.
#
# Version: pin 4.1.0, mujoco 4.0.0, numpy 2.4.6, Python 3.11.
# Expected: the axis gives a direction and is normalized, as for MuJoCo, and as Pinocchio does with quaternions.
# Behaviour: the formula for unit axes is applied as it is. The placement of the joint has a determinant other than one,
#   and everything behind it is stretched: a tip one metre from the joint is two metres away. Nothing is said.
# Output (axisangle="0 0 2 1.5708"):
#   MuJoCo: determinant 1.0, distance of the tip 1.0
#   Pinocchio: determinant 64.0, distance of the tip 2.0
# Remedy: write quaternions; save the model from MuJoCo first.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import pathlib
import tempfile

import mujoco
import numpy as np
import pinocchio

text = """<mujoco><compiler angle="radian"/><worldbody><body name="arm" axisangle="0 0 2 1.5707963267948966">
<joint name="turn"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><body name="tip" pos="1 0 0">
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></body></worldbody></mujoco>"""
with tempfile.TemporaryDirectory() as folder:
    path = pathlib.Path(folder, "arm.xml")
    path.write_text(text)
    first = mujoco.MjModel.from_xml_path(str(path))
    second = pinocchio.buildModelFromMJCF(str(path))
state, data = mujoco.MjData(first), second.createData()
mujoco.mj_forward(first, state)
pinocchio.framesForwardKinematics(second, data, np.zeros(1))
frame = data.oMf[second.getFrameId("tip", pinocchio.FrameType.BODY)]
matrices = {
    "MuJoCo": (state.body("tip").xmat.reshape(3, 3), state.body("tip").xpos),
    "Pinocchio": (frame.rotation, frame.translation),
}
seen = {
    name: [round(float(np.linalg.det(turn)), 3), round(float(np.linalg.norm(place)), 3)]
    for name, (turn, place) in matrices.items()
}
for name, (determinant, distance) in seen.items():
    print(f"{name}: determinant {determinant}, distance of the tip {distance}")
expected = {"MuJoCo": [1.0, 1.0], "Pinocchio": [64.0, 2.0]}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
