#!/usr/bin/env bash
# Maps of the two kinds give different pictures in OpenCV 5, and undistort equals only one of them.
#
# Version: opencv-python-headless 5.0.0.93, numpy 2.4.6, Python 3.11.
# Expected: undistort is initUndistortRectifyMap and remap, as its page says, whichever kind of map is used.
# Behaviour: it is exactly the remap of maps in fixed point. Maps of float32 give other values in a large part of the
#   pixels, here of noise.
# Output:
#   fixed point: equal
#   float32: different
# Remedy: compare with a tolerance; keep one kind of map throughout a chain.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check opencv-python-headless==5.0.0.93 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import cv2
import numpy as np

picture = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
camera = np.array([[100.0, 0.0, 80.0], [0.0, 100.0, 60.0], [0.0, 0.0, 1.0]])
lens = np.array([0.1, -0.05, 0.0, 0.0, 0.0])
plain = cv2.undistort(picture, camera, lens)
seen = {}
for name, kind in (("fixed point", cv2.CV_16SC2), ("float32", cv2.CV_32FC1)):
    maps = cv2.initUndistortRectifyMap(camera, lens, None, camera, (160, 120), kind)
    same = np.array_equal(plain, cv2.remap(picture, *maps, cv2.INTER_LINEAR))
    seen[name] = "equal" if same else "different"
    print(f"{name}: {seen[name]}")
expected = {"fixed point": "equal", "float32": "different"}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
