#!/usr/bin/env bash
# Pinocchio adds the inertia of a link without mass to the arm, where MuJoCo drops it.
#
# Version: pin 4.1.0, mujoco 4.0.0, numpy 2.4.6, Python 3.11.
# Expected: two readers of one URDF agree on the joint's inertia. Links of frames with mass 0 and a nominal inertia are
#   found in files that people use.
# Behaviour: Pinocchio keeps the 0.2 of the frame's link: the joint has 0.21. MuJoCo fuses the link away: the joint has
#   0.01. Torques of planned motions, and rate limits of them, differ by a factor of twenty.
# Output:
#   Pinocchio 0.21, MuJoCo 0.01
# Remedy: remove inertial elements without mass before Pinocchio reads a file.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import mujoco
import numpy as np
import pinocchio

tensor = '<inertia ixx="{0}" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"/>'
text = f"""<robot name="wrist"><link name="base"/>
<link name="arm"><inertial><mass value="1"/>{tensor.format(0.01)}</inertial></link>
<link name="frame"><inertial><mass value="0"/>{tensor.format(0.2)}</inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="20" velocity="1"/></joint>
<joint name="fixed" type="fixed"><parent link="arm"/><child link="frame"/></joint></robot>"""
first = pinocchio.buildModelFromXML(text)
second = mujoco.MjModel.from_xml_string(text)
data = mujoco.MjData(second)
mujoco.mj_forward(second, data)
seen = [
    round(float(pinocchio.crba(first, first.createData(), np.zeros(1))[0, 0]), 6),
    round(float(second.dof_M0[0]), 6),
]
print("Pinocchio {}, MuJoCo {}".format(*seen))
raise SystemExit(0 if seen == [0.21, 0.01] else "the behaviour has changed")
PYTHON
