#!/usr/bin/env bash
# A box that sleeps on the floor touches nothing, and no force holds it.
#
# Version: mujoco 4.0.0, Python 3.11.
# Expected: falling asleep saves time and changes no answer; what lies on the floor has contacts with it.
# Behaviour: with the flag "sleep" the contacts of a resting box are gone once it sleeps, and so is the constraint
#   force that carries its weight. mj_forward and mj_collision do not bring them back.
# Output:
#   awake: contacts 4, force 9.81
#   asleep: contacts 0, force 0.0
# Remedy: no sleeping where contacts answer whether something is supported or held.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mujoco==4.0.0
"$folder/venv/bin/python" - <<'PYTHON'
import mujoco

text = """<mujoco><option><flag sleep="{}"/></option><worldbody><geom type="plane" size="1 1 .1"/>
<body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body></worldbody></mujoco>"""


def rest(flag):
    """Contacts and vertical force of a box after three thousand steps, everything computed anew."""
    model = mujoco.MjModel.from_xml_string(text.format(flag))
    data = mujoco.MjData(model)
    for _ in range(3000):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    mujoco.mj_collision(model, data)
    return data.ncon, round(float(data.qfrc_constraint[2]), 3)


seen = {"awake": rest("disable"), "asleep": rest("enable")}
for name, (contacts, force) in seen.items():
    print(f"{name}: contacts {contacts}, force {force}")
raise SystemExit(0 if seen == {"awake": (4, 9.81), "asleep": (0, 0.0)} else "the behaviour has changed")
PYTHON
