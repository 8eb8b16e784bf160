#!/usr/bin/env bash
# Pinocchio converts the range of a MJCF slide joint from degrees, so that half a metre is nine millimetres.
#
# Version: pin 4.1.0, mujoco 4.0.0, numpy 2.4.6, Python 3.11.
# Expected: the compiler's unit of angles concerns angles only. "degree" is what a MJCF file without that attribute has.
# Behaviour: the limits of a slide joint are divided by 57.3 too, unless the file says angle="radian". The position for
#   which the joint is at its reference is not converted, so only the limits are wrong.
# Output (upper limit of range="0 0.5"):
#   degree: MuJoCo 0.5, Pinocchio 0.0087
#   radian: MuJoCo 0.5, Pinocchio 0.5
# Remedy: save the model from MuJoCo, which writes radians, before Pinocchio reads it.
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

text = """<mujoco><compiler angle="{}"/><worldbody><body name="finger">
<joint name="slide" type="slide" range="0 0.5"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
</body></worldbody></mujoco>"""
seen = {}
with tempfile.TemporaryDirectory() as folder:
    for unit in ("degree", "radian"):
        path = pathlib.Path(folder, "finger.xml")
        path.write_text(text.format(unit))
        first = mujoco.MjModel.from_xml_path(str(path)).jnt_range[0, 1]
        second = pinocchio.buildModelFromMJCF(str(path)).upperPositionLimit[0]
        seen[unit] = [round(float(first), 4), round(float(second), 4)]
for unit, (first, second) in seen.items():
    print(f"{unit}: MuJoCo {first}, Pinocchio {second}")
expected = {"degree": [0.5, 0.0087], "radian": [0.5, 0.5]}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
