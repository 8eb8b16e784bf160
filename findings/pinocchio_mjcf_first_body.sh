#!/usr/bin/env bash
# Of several bodies beside each other in a MJCF world Pinocchio reads the first one only.
#
# Version: pin 4.1.0, mujoco 4.0.0, numpy 2.4.6, Python 3.11.
# Expected: two arms in one worldbody are two joints, as in MuJoCo; or an error says what cannot be read.
# Behaviour: the first body is read and the ones after it are left out without a word. A body inside a "frame" element
#   is left out too. A second worldbody, as "include" gives, is read as the first body once more.
# Output (joints):
#   two bodies: MuJoCo left right, Pinocchio left
#   body in a frame: MuJoCo left right, Pinocchio left
#   two worldbodies: MuJoCo left right, Pinocchio left left
# Remedy: compare the names of joints after loading; let MuJoCo write the file again, or put everything into one fixed
#   body without frames.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import pathlib
import tempfile

import mujoco
import pinocchio

body = """<body name="{0}"><joint name="{0}"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{1}</body>"""
left, right = body.format("left", ""), body.format("right", "")
files = {
    "two bodies": f"<mujoco><worldbody>{left}{right}</worldbody></mujoco>",
    "body in a frame": f"<mujoco><worldbody>{body.format('left', f'<frame>{right}</frame>')}</worldbody></mujoco>",
    "two worldbodies": f"<mujoco><worldbody>{left}</worldbody><worldbody>{right}</worldbody></mujoco>",
}
seen = {}
with tempfile.TemporaryDirectory() as folder:
    for name, text in files.items():
        path = pathlib.Path(folder, "arms.xml")
        path.write_text(text)
        first = mujoco.MjModel.from_xml_path(str(path))
        second = pinocchio.buildModelFromMJCF(str(path))
        seen[name] = [first.joint(index).name for index in range(first.njnt)], list(second.names)[1:]
for name, (one, other) in seen.items():
    print(f"{name}: MuJoCo {' '.join(one)}, Pinocchio {' '.join(other)}")
both = ["left", "right"]
expected = [(both, ["left"]), (both, ["left"]), (both, ["left", "left"])]
raise SystemExit(0 if list(seen.values()) == expected else "the behaviour has changed")
PYTHON
