#!/usr/bin/env bash
# A weld that is made through MjSpec has its anchor a metre away from where XML puts it.
#
# Version: mujoco 4.0.0, Python 3.11.
# Expected: a weld of two bodies without further data is the same from XML and from MjSpec.add_equality.
# Behaviour: the data of a new equality begins with 0 1 0, which suits a joint's polynomial. For a weld it is the
#   anchor, so the weld holds at a point one metre along y. At rest nothing shows; under load the lever is another one.
# Output:
#   XML: anchor [0.0, 0.0, 0.0]
#   MjSpec: anchor [0.0, 1.0, 0.0]
# Remedy: set data[:3] to zero, or to the anchor that is meant, when adding a weld.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mujoco==4.0.0
"$folder/venv/bin/python" - <<'PYTHON'
import mujoco

text = """<mujoco><worldbody>
<body name="a" pos="0 0 1"><freejoint/><geom size=".1"/></body>
<body name="b" pos="1 0 1"><freejoint/><geom size=".1"/></body>
</worldbody>{}</mujoco>"""
plain = mujoco.MjModel.from_xml_string(text.format('<equality><weld body1="a" body2="b"/></equality>'))
spec = mujoco.MjSpec.from_string(text.format(""))
spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1="a", name2="b")
seen = {"XML": plain.eq_data[0, :3].tolist(), "MjSpec": spec.compile().eq_data[0, :3].tolist()}
for name, anchor in seen.items():
    print(f"{name}: anchor {anchor}")
expected = {"XML": [0.0, 0.0, 0.0], "MjSpec": [0.0, 1.0, 0.0]}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
