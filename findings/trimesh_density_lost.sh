#!/usr/bin/env bash
# In trimesh a mesh loses its density when it is split, joined, cut finer or replaced by its hull.
#
# Version: trimesh 5.2.0, scipy 1.17.1, networkx 3.6.1, numpy 2.4.6, Python 3.11.
# Expected: density belongs to the mesh as its colours do, and what is made of it has the same one.
# Behaviour: copy and apply_scale keep it. The results of split, concatenate, subdivide and convex_hull have density 1
#   again, so masses and inertias of a link in a simulation are a thousandth.
# Output (mass of a cubic metre of density 1000, of two of them for concatenate):
#   copy: 1000.0
#   split: 1.0
#   concatenate: 2.0
#   subdivide: 1.0
#   convex_hull: 1.0
# Remedy: set the density last, just before mass and inertia are read.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check trimesh==5.2.0 scipy==1.17.1 networkx==3.6.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import trimesh

box = trimesh.creation.box((1.0, 1.0, 1.0))
box.density = 1000.0
far = box.copy()
far.apply_translation([2.0, 0.0, 0.0])
results = {
    "copy": box.copy(),
    "split": box.split()[0],
    "concatenate": trimesh.util.concatenate([box, far]),
    "subdivide": box.subdivide(),
    "convex_hull": box.convex_hull,
}
seen = {name: round(float(mesh.mass), 3) for name, mesh in results.items()}
for name, mass in seen.items():
    print(f"{name}: {mass}")
expected = {"copy": 1000.0, "split": 1.0, "concatenate": 2.0, "subdivide": 1.0, "convex_hull": 1.0}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
