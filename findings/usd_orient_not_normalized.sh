#!/usr/bin/env bash
# In USD an orient of 1 0 0 1 turns nothing, and one of 0.7 0 0 0.7 turns too far.
#
# Version: usd-core 26.11, numpy 2.4.6, Python 3.11.
# Expected: a quaternion that is not of length one is normalized, as by MuJoCo and scipy, or refused. All of these are a
#   quarter turn about z, and files with few digits hold such numbers.
# Behaviour: the angle is taken from the real part alone, and the axis from the imaginary part. A real part of one or
#   more is no turn at all.
# Output (orient, angle about z in degrees):
#   0.70710678 0 0 0.70710678: 90.0
#   0.7 0 0 0.7: 91.1
#   0.5 0 0 0.5: 120.0
#   1 0 0 1: 0.0
# Remedy: normalize with GetNormalized() before setting, and check what others wrote.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check usd-core==26.11 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
from pxr import Gf, Usd, UsdGeom

stage = Usd.Stage.CreateInMemory()
seen = {}
for number, part in enumerate(("0.70710678", "0.7", "0.5", "1")):
    frame = UsdGeom.Xform.Define(stage, f"/frame{number}")
    frame.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(float(part), 0.0, 0.0, float(part)))
    turned = frame.GetLocalTransformation().TransformDir(Gf.Vec3d(1.0, 0.0, 0.0))
    seen[f"{part} 0 0 {part}"] = round(float(np.degrees(np.arctan2(turned[1], turned[0]))), 1)
for orient, angle in seen.items():
    print(f"{orient}: {angle}")
raise SystemExit(0 if list(seen.values()) == [90.0, 91.1, 120.0, 0.0] else "the behaviour has changed")
PYTHON
