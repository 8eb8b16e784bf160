#!/usr/bin/env bash
# A new LAS cloud of laspy rounds all points to whole centimetres, before anything is written.
#
# Version: laspy 2.7.0, numpy 2.4.6, Python 3.11.
# Expected: coordinates that are set as float64 come back as they were, or with a resolution that suits them, or an
#   error asks for one.
# Behaviour: the format keeps integers and a scale, and a new header has the scale 0.01. Points of a scan of a table,
#   which are in metres, move by up to 5 mm. x, y and z answer the rounded numbers at once; no warning.
# Output (largest movement, metres):
#   as created: 0.005
#   with scales of 1e-5: 0.0
# Remedy: set header.scales before the coordinates.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check laspy==2.7.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import laspy
import numpy as np

places = np.linspace(0.0, 1.0, 1001).reshape(-1, 1) * np.ones(3)


def moved(**choice):
    """Largest movement of a coordinate by setting it, rounded to tenths of a millimetre."""
    header = laspy.LasHeader(point_format=3)
    if choice:
        header.scales = np.array(choice["scales"])
    cloud = laspy.LasData(header)
    cloud.xyz = places
    return round(float(np.max(np.abs(np.asarray(cloud.xyz) - places))), 4)


seen = {"as created": moved(), "with scales of 1e-5": moved(scales=[1e-5, 1e-5, 1e-5])}
for name, distance in seen.items():
    print(f"{name}: {distance}")
raise SystemExit(0 if list(seen.values()) == [0.005, 0.0] else "the behaviour has changed")
PYTHON
