#!/usr/bin/env bash
# Volume and area of a trimesh scene leave out the scale at which its meshes stand there.
#
# Version: trimesh 5.2.0, scipy 1.17.1, networkx 3.6.1, numpy 2.4.6, Python 3.11.
# Expected: bounds, volume and area of a scene are those of what is seen in it, as each mesh is counted for every place
#   where it stands. URDF and GLB files scale meshes in just this way.
# Behaviour: bounds use the transforms of the scene; volume and area add up the meshes as they were loaded. After
#   scene.apply_scale the two do not fit together.
# Output (a cube of 1 m, scale 2):
#   bounds: 2.0 m wide
#   scene: volume 1.0, area 6.0
#   its meshes in one: volume 8.0, area 24.0
# Remedy: scene.to_mesh() first.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check trimesh==5.2.0 scipy==1.17.1 networkx==3.6.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import trimesh

scene = trimesh.Scene([trimesh.creation.box((1.0, 1.0, 1.0))])
scene.apply_scale(2.0)
mesh = scene.to_mesh()
seen = [float(scene.extents[0]), scene.volume, scene.area, mesh.volume, mesh.area]
seen = [round(float(number), 6) for number in seen]
print(f"bounds: {seen[0]} m wide")
print(f"scene: volume {seen[1]}, area {seen[2]}")
print(f"its meshes in one: volume {seen[3]}, area {seen[4]}")
raise SystemExit(0 if seen == [2.0, 1.0, 6.0, 8.0, 24.0] else "the behaviour has changed")
PYTHON
