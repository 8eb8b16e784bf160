#!/usr/bin/env bash
# OpenCV 5 has other numbers for its types, and the names of hand-eye methods without the function.
#
# Version: opencv-python-headless 5.0.0.93, numpy 2.4.6, Python 3.11.
# Expected: CV_8UC3 is 16 and CV_32FC1 is 5, as in OpenCV 4 and in files and tables that store them; and
#   calibrateHandEye is there as its constants are.
# Behaviour: numbers of types with several channels have changed, those with one channel have not. calibrateHandEye and
#   calibrateRobotWorldHandEye are missing; CALIB_HAND_EYE_TSAI is still there.
# Output:
#   CV_8UC3: 64
#   CV_16SC2: 35
#   CV_32FC1: 5
#   calibrateHandEye: missing
#   CALIB_HAND_EYE_TSAI: there
# Remedy: store names of types; hand-eye calibration is computed without OpenCV.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check opencv-python-headless==5.0.0.93 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import cv2

seen = {name: getattr(cv2, name) for name in ("CV_8UC3", "CV_16SC2", "CV_32FC1")}
for name in ("calibrateHandEye", "CALIB_HAND_EYE_TSAI"):
    seen[name] = "there" if hasattr(cv2, name) else "missing"
for name, what in seen.items():
    print(f"{name}: {what}")
raise SystemExit(0 if list(seen.values()) == [64, 35, 5, "missing", "there"] else "the behaviour has changed")
PYTHON
