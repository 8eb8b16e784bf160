#!/usr/bin/env bash
# Pinocchio moves a planar joint in the xy plane whatever its axis is; MuJoCo takes the plane across the axis.
#
# Version: pin 4.1.0, mujoco 4.0.0, numpy 2.4.6, Python 3.11.
# Expected: the axis of a planar joint is the normal of its plane, as the URDF page says; with axis 1 0 0 nothing moves
#   along x.
# Behaviour: Pinocchio ignores the axis. The first coordinate moves along x, which is the normal. Nothing is said.
# Output (position of the link when the first coordinate is 0.5, axis 1 0 0):
#   Pinocchio [0.5, 0.0, 0.0]
#   MuJoCo [0.0, 0.0, -0.5]
# Remedy: give the joint an origin that turns it and the axis 0 0 1, which both read alike.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import mujoco
import numpy as np
import pinocchio

text = """<robot name="base"><link name="floor"/><link name="cart"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="drive" type="planar"><parent link="floor"/><child link="cart"/><axis xyz="1 0 0"/></joint></robot>"""
first = pinocchio.buildModelFromXML(text)
data = first.createData()
step = np.array([0.5, 0.0, 0.0])
pinocchio.framesForwardKinematics(first, data, pinocchio.integrate(first, pinocchio.neutral(first), step))
second = mujoco.MjModel.from_xml_string(text)
state = mujoco.MjData(second)
state.qpos[0] = 0.5
mujoco.mj_forward(second, state)
seen = {
    "Pinocchio": data.oMf[first.getFrameId("cart")].translation,
    "MuJoCo": state.body("cart").xpos,
}
seen = {name: (np.round(place, 6) + 0.0).tolist() for name, place in seen.items()}
for name, place in seen.items():
    print(name, place)
expected = {"Pinocchio": [0.5, 0.0, 0.0], "MuJoCo": [0.0, 0.0, -0.5]}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
