#!/usr/bin/env bash
# One URDF of a gripper with a mimic joint has two free joints, one joint, or two and an equality, depending on the
#   reader.
#
# Version: pin 4.1.0, mujoco 4.0.0, yourdfpy 0.0.60, numpy 2.4.6, Python 3.11.
# Expected: the second finger follows the first, and the configuration has one number.
# Behaviour: Pinocchio lets both fingers move freely unless mimic=True is given; MuJoCo has two joints and makes a soft
#   equality of them, so that writing the first position alone moves one finger; yourdfpy has one joint.
# Output (joint coordinates, and height of the second finger when the first coordinate is 0.04):
#   Pinocchio: 2, 0.0
#   Pinocchio with mimic=True: 1, 0.04
#   MuJoCo: 2 and 1 equality, 0.0
#   yourdfpy: 1, 0.04
# Remedy: set both fingers wherever a configuration is written.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 yourdfpy==0.0.60 trimesh==5.2.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import io

import mujoco
import numpy as np
import pinocchio
import yourdfpy

inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
joint = """<joint name="{0}" type="prismatic"><parent link="hand"/><child link="{0}_finger"/><axis xyz="0 0 1"/>
<limit lower="0" upper="0.04" effort="20" velocity="1"/>{1}</joint>"""
text = f"""<robot name="gripper"><link name="hand"/><link name="a_finger">{inertial}</link>
<link name="b_finger">{inertial}</link>{joint.format("a", "")}{joint.format("b", '<mimic joint="a"/>')}</robot>"""


def by_pinocchio(**options):
    """Coordinates and height of the second finger by Pinocchio."""
    model = pinocchio.buildModelFromXML(text, **options)
    data, q = model.createData(), pinocchio.neutral(model)
    q[0] = 0.04
    pinocchio.framesForwardKinematics(model, data, q)
    return model.nq, round(float(data.oMf[model.getFrameId("b_finger")].translation[2]), 6)


model = mujoco.MjModel.from_xml_string(text)
data = mujoco.MjData(model)
data.qpos[0] = 0.04
mujoco.mj_forward(model, data)
robot = yourdfpy.URDF.load(io.BytesIO(text.encode()), load_meshes=False)
robot.update_cfg(np.array([0.04]))
seen = {
    "Pinocchio": by_pinocchio(),
    "Pinocchio with mimic=True": by_pinocchio(mimic=True),
    "MuJoCo": (f"{model.nq} and {model.neq} equality", round(float(data.body("b_finger").xpos[2]), 6)),
    "yourdfpy": (robot.num_actuated_joints, round(float(robot.get_transform("b_finger")[2, 3]), 6)),
}
for name, (count, height) in seen.items():
    print(f"{name}: {count}, {height}")
expected = [(2, 0.0), (1, 0.04), ("2 and 1 equality", 0.0), (1, 0.04)]
raise SystemExit(0 if list(seen.values()) == expected else "the behaviour has changed")
PYTHON
