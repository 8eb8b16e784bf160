#!/usr/bin/env bash
# A floating or planar joint of a URDF takes one number in yourdfpy, and the number moves nothing.
#
# Version: yourdfpy 0.0.60, trimesh 5.2.0, numpy 2.4.6, Python 3.11.
# Expected: a floating joint has six or seven numbers and a planar one three; or they are refused as unsupported.
# Behaviour: each counts as an actuated joint with one number in the configuration. Whatever is written there, the link
#   stays where it is. Code that moves the base by this joint runs and does nothing.
# Output (numbers in the configuration, and how far the link has moved at 0.5):
#   revolute: 1, moved True
#   floating: 1, moved False
#   planar: 1, moved False
# Remedy: keep the pose of the base outside, and give the file a fixed joint there.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check yourdfpy==0.0.60 trimesh==5.2.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import io

import numpy as np
import yourdfpy

text = """<robot name="arm"><link name="world"/><link name="base"/>
<joint name="drive" type="{}"><parent link="world"/><child link="base"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="20" velocity="1"/></joint></robot>"""
seen = {}
for kind in ("revolute", "floating", "planar"):
    robot = yourdfpy.URDF.load(io.BytesIO(text.format(kind).encode()), load_meshes=False)
    before = robot.get_transform("base").copy()
    robot.update_cfg(np.full(robot.num_actuated_joints, 0.5))
    seen[kind] = robot.num_actuated_joints, not np.allclose(before, robot.get_transform("base"))
for kind, (count, moved) in seen.items():
    print(f"{kind}: {count}, moved {moved}")
expected = {"revolute": (1, True), "floating": (1, False), "planar": (1, False)}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
