#!/usr/bin/env bash
# Pinocchio reads a MJCF file and leaves its gravity out.
#
# Version: pin 4.1.0, mujoco 4.0.0, numpy 2.4.6, Python 3.11.
# Expected: the option "gravity" of the file becomes the gravity of the model, as its armatures and dampings do.
# Behaviour: gravity is always 9.81 along -z. An arm that hangs from a wall or is meant to be without gravity gets
#   torques of another world.
# Output:
#   0 0 -9.81: MuJoCo [0.0, 0.0, -9.81], Pinocchio [0.0, 0.0, -9.81]
#   -9.81 0 0: MuJoCo [-9.81, 0.0, 0.0], Pinocchio [0.0, 0.0, -9.81]
#   0 0 0: MuJoCo [0.0, 0.0, 0.0], Pinocchio [0.0, 0.0, -9.81]
# Remedy: set model.gravity.linear after loading.
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

text = """<mujoco><option gravity="{}"/><worldbody><body name="arm"><joint name="turn" armature="0.1"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>"""
seen = {}
with tempfile.TemporaryDirectory() as folder:
    for gravity in ("0 0 -9.81", "-9.81 0 0", "0 0 0"):
        path = pathlib.Path(folder, "arm.xml")
        path.write_text(text.format(gravity))
        first = mujoco.MjModel.from_xml_path(str(path))
        second = pinocchio.buildModelFromMJCF(str(path))
        assert first.dof_armature[0] == second.armature[0] == 0.1
        seen[gravity] = [first.opt.gravity.tolist(), second.gravity.linear.tolist()]
for gravity, (one, other) in seen.items():
    print(f"{gravity}: MuJoCo {one}, Pinocchio {other}")
down = [0.0, 0.0, -9.81]
expected = [[down, down], [[-9.81, 0.0, 0.0], down], [[0.0, 0.0, 0.0], down]]
raise SystemExit(0 if list(seen.values()) == expected else "the behaviour has changed")
PYTHON
