#!/usr/bin/env bash
# Numbers of a URDF attribute that are separated by a line break or a tab are refused by Pinocchio.
#
# Version: pin 4.1.0 (with urdfdom 6.0.0), mujoco 4.0.0, yourdfpy 0.0.60, numpy 2.4.6, Python 3.11.
# Expected: XML turns line breaks and tabs in attributes into spaces before a program sees them, so the three files are
#   the same. Editors and formatters break long lines there.
# Behaviour: urdfdom gets the characters as they are and splits at spaces only. Pinocchio, which reads with it, says
#   that the component cannot be parsed. MuJoCo and yourdfpy read all three alike.
# Output:
#   space: Pinocchio read, MuJoCo read, yourdfpy read
#   line break: Pinocchio refused, MuJoCo read, yourdfpy read
#   tab: Pinocchio refused, MuJoCo read, yourdfpy read
# Remedy: read and write the file once with an XML library that follows the rule, such as Python's xml.etree.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 yourdfpy==0.0.60 trimesh==5.2.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import io
import os

import mujoco
import pinocchio
import yourdfpy

text = """<robot name="arm"><link name="base"/><link name="tip"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0{0}0{0}1"/>
<limit lower="-1" upper="1" effort="20" velocity="1"/></joint></robot>"""
readers = {
    "Pinocchio": pinocchio.buildModelFromXML,
    "MuJoCo": mujoco.MjModel.from_xml_string,
    "yourdfpy": lambda file: yourdfpy.URDF.load(io.BytesIO(file.encode()), load_meshes=False),
}


def read(reader, file):
    """Whether a reader takes the file."""
    try:
        reader(file)
    except ValueError:
        return "refused"
    return "read"


os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # urdfdom explains itself on the error stream
seen = {}
for name, between in (("space", " "), ("line break", "\n"), ("tab", "\t")):
    seen[name] = {reader: read(function, text.format(between)) for reader, function in readers.items()}
    print(f"{name}: {', '.join(f'{reader} {what}' for reader, what in seen[name].items())}")
refused = {"Pinocchio": "refused", "MuJoCo": "read", "yourdfpy": "read"}
expected = {"space": dict.fromkeys(readers, "read"), "line break": refused, "tab": refused}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
