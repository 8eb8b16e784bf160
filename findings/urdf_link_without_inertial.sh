#!/usr/bin/env bash
# A URDF link that has a collision box and no inertial element weighs a ton in MuJoCo and nothing in Pinocchio.
#
# Version: pin 4.1.0, mujoco 4.0.0, numpy 2.4.6, Python 3.11.
# Expected: the inertial element is optional and a link without it has no mass, as the URDF page says; files leave it
#   out of brackets and of fixed tables.
# Behaviour: MuJoCo fills such links with its own density, 1000 kg/m3, and does not say so. Pinocchio gives no mass. A
#   plan with one and a simulation with the other have torques that have nothing in common.
# Output (mass of a link with a box of 1 x 1 x 1 m):
#   collision only: MuJoCo 1000.0, Pinocchio 0.0
#   collision and inertial of 2 kg: MuJoCo 2.0, Pinocchio 2.0
# Remedy: give every link that has a shape an inertial element; compare total masses after loading.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import mujoco
import pinocchio

text = """<robot name="arm"><link name="base"/><link name="tip">{}
<collision><geometry><box size="1 1 1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="20" velocity="1"/></joint></robot>"""
inertial = """<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""
seen = {}
for name, element in (("collision only", ""), ("collision and inertial of 2 kg", inertial)):
    first = mujoco.MjModel.from_xml_string(text.format(element))
    second = pinocchio.buildModelFromXML(text.format(element))
    masses = first.body("tip").mass[0], second.inertias[1].mass
    seen[name] = [round(float(mass), 6) for mass in masses]
for name, (one, other) in seen.items():
    print(f"{name}: MuJoCo {one}, Pinocchio {other}")
expected = [[1000.0, 0.0], [2.0, 2.0]]
raise SystemExit(0 if list(seen.values()) == expected else "the behaviour has changed")
PYTHON
