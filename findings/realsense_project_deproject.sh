#!/usr/bin/env bash
# Projecting and deprojecting of librealsense are not inverse to each other for two of its distortion models.
#
# Version: pyrealsense2 2.59.1.11053, Python 3.11; no camera is needed.
# Expected: a pixel that is deprojected to a point and projected again is the same pixel, for every model of
#   distortion.
# Behaviour: for modified_brown_conrady deprojecting leaves the distortion out and projecting applies it; for ftheta
#   both apply something else. Nothing is raised. brown_conrady and inverse_brown_conrady come back.
# Output (pixel 500, 100 there and back):
#   brown_conrady: 500.0 100.0
#   inverse_brown_conrady: 500.0 100.0
#   kannala_brandt4: 500.0 100.0
#   modified_brown_conrady: 502.5 98.2
#   ftheta: 514.3 88.9
# Remedy: look at the model of the stream; undistort pictures of these two models by other means.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pyrealsense2==2.59.1.11053
"$folder/venv/bin/python" - <<'PYTHON'
import pyrealsense2


def there_and_back(model, coefficients):
    """Pixel (500, 100) after deprojecting at 1 m and projecting again."""
    camera = pyrealsense2.intrinsics()
    camera.width, camera.height = 640, 480
    camera.fx, camera.fy, camera.ppx, camera.ppy = 600.0, 600.0, 320.0, 240.0
    camera.model = getattr(pyrealsense2.distortion, model)
    camera.coeffs = coefficients
    point = pyrealsense2.rs2_deproject_pixel_to_point(camera, [500.0, 100.0], 1.0)
    return [round(value, 1) for value in pyrealsense2.rs2_project_point_to_pixel(camera, point)]


brown = [0.1, -0.05, 0.001, 0.001, 0.0]
seen = {
    model: there_and_back(model, brown)
    for model in ("brown_conrady", "inverse_brown_conrady", "kannala_brandt4", "modified_brown_conrady")
}
seen["ftheta"] = there_and_back("ftheta", [0.5, 0.0, 0.0, 0.0, 0.0])
for model, pixel in seen.items():
    print(f"{model}: {pixel[0]} {pixel[1]}")
expected = [[500.0, 100.0]] * 3 + [[502.5, 98.2], [514.3, 88.9]]
raise SystemExit(0 if list(seen.values()) == expected else "the behaviour has changed")
PYTHON
