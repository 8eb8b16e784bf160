#!/usr/bin/env bash
# The coordinates of one URDF are in three different orders in Pinocchio, MuJoCo and yourdfpy.
#
# Version: pin 4.1.0, mujoco 4.0.0, yourdfpy 0.0.60, numpy 2.4.6, Python 3.11.
# Expected: a configuration is one list of numbers, in the order of the file, for whoever reads the file.
# Behaviour: where a link has two children, MuJoCo goes down the first branch in the order of the file, Pinocchio down
#   the first branch in the order of names, and yourdfpy takes the joints as they are written. Vectors have the same
#   length, so a swap raises nothing. A single chain has one order, which hides this.
# Output:
#   Pinocchio: arm elbow wrist head
#   MuJoCo: head arm elbow wrist
#   yourdfpy: wrist head arm elbow
# Remedy: exchange configurations as names with numbers.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 yourdfpy==0.0.60 trimesh==5.2.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import io

import mujoco
import pinocchio
import yourdfpy

inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
joint = """<joint name="{1}" type="revolute"><parent link="{0}"/><child link="{1}_link"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="20" velocity="1"/></joint>"""
pairs = [("elbow_link", "wrist"), ("base", "head"), ("base", "arm"), ("arm_link", "elbow")]
links = "".join(f'<link name="{name}_link">{inertial}</link>' for _, name in pairs)
joints = "".join(joint.format(parent, name) for parent, name in pairs)
text = f'<robot name="torso"><link name="base"/>{links}{joints}</robot>'
first = pinocchio.buildModelFromXML(text)
second = mujoco.MjModel.from_xml_string(text)
third = yourdfpy.URDF.load(io.BytesIO(text.encode()), load_meshes=False)
seen = {
    "Pinocchio": list(first.names)[1:],
    "MuJoCo": [second.joint(index).name for index in range(second.njnt)],
    "yourdfpy": list(third.actuated_joint_names),
}
for name, order in seen.items():
    print(f"{name}: {' '.join(order)}")
expected = ["arm elbow wrist head", "head arm elbow wrist", "wrist head arm elbow"]
raise SystemExit(0 if [" ".join(order) for order in seen.values()] == expected else "the behaviour has changed")
PYTHON
