#!/usr/bin/env bash
# A limit with an upper bound only is 0 to 1, -inf to 1, or no limit at all, depending on the reader of the URDF.
#
# Version: pin 4.1.0, mujoco 4.0.0, yourdfpy 0.0.60, ikpy 4.2.1, numpy 2.4.6, Python 3.11.
# Expected: lower and upper are optional and default to 0, as the URDF page says, so the range is 0 to 1; and a limit
#   with neither holds the joint at 0.
# Behaviour: Pinocchio does so. MuJoCo stores the range 0 to 1 and switches the limit off. ikpy leaves the lower side
#   open, yourdfpy gives None. Nothing is said.
# Output (upper="1"; neither):
#   Pinocchio: 0.0 to 1.0; 0.0 to 0.0
#   MuJoCo: 0.0 to 1.0, off; 0.0 to 0.0, off
#   yourdfpy: None to 1.0; None to None
#   ikpy: -inf to 1.0; -inf to inf
# Remedy: write both bounds of every joint.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 yourdfpy==0.0.60 trimesh==5.2.0 ikpy==4.2.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import io
import pathlib
import tempfile
import warnings

import mujoco
import pinocchio
import yourdfpy
from ikpy.chain import Chain

text = """<robot name="arm"><link name="base"/><link name="tip"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
<limit {} effort="20" velocity="1"/></joint></robot>"""


def limits(bounds):
    """What four readers make of these attributes of a limit."""
    file = text.format(bounds)
    first = pinocchio.buildModelFromXML(file)
    second = mujoco.MjModel.from_xml_string(file)
    third = yourdfpy.URDF.load(io.BytesIO(file.encode()), load_meshes=False).joint_map["turn"].limit
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = pathlib.Path(folder, "arm.urdf")
        path.write_text(file)
        fourth = Chain.from_urdf_file(str(path), base_elements=["base"]).links[1].bounds
    switch = "" if second.jnt_limited[0] else ", off"
    return [
        f"{first.lowerPositionLimit[0]} to {first.upperPositionLimit[0]}",
        f"{second.jnt_range[0, 0]} to {second.jnt_range[0, 1]}{switch}",
        f"{third.lower} to {third.upper}",
        f"{fourth[0]} to {fourth[1]}",
    ]


seen = ["; ".join(pair) for pair in zip(limits('upper="1"'), limits(""))]
for name, what in zip(("Pinocchio", "MuJoCo", "yourdfpy", "ikpy"), seen):
    print(f"{name}: {what}")
expected = [
    "0.0 to 1.0; 0.0 to 0.0",
    "0.0 to 1.0, off; 0.0 to 0.0, off",
    "None to 1.0; None to None",
    "-inf to 1.0; -inf to inf",
]
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
