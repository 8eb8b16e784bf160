#!/usr/bin/env bash
# safetensors saves the memory of a transposed numpy array under the shape of the transposed one.
#
# Version: safetensors 0.8.0, numpy 2.4.6, Python 3.11.
# Expected: a transposed array comes back as it was, or is refused, as the module for torch refuses it.
# Behaviour: the bytes are written in the order of memory and read in the order of rows, so that the numbers are in
#   other places. Nothing is said. asfortranarray and results of einsum and solve are arrays of this kind.
# Output:
#   saved:    [[0.0, 3.0], [1.0, 4.0], [2.0, 5.0]]
#   loaded:   [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]]
#   of a copy: [[0.0, 3.0], [1.0, 4.0], [2.0, 5.0]]
# Remedy: numpy.ascontiguousarray on everything before it is saved.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check safetensors==0.8.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
from safetensors.numpy import load, save

array = np.arange(6.0).reshape(2, 3).T
loaded = load(save({"weight": array}))["weight"].tolist()
copied = load(save({"weight": np.ascontiguousarray(array)}))["weight"].tolist()
print("saved:   ", array.tolist())
print("loaded:  ", loaded)
print("of a copy:", copied)
same = loaded == np.arange(6.0).reshape(3, 2).tolist() and copied == array.tolist()
raise SystemExit(0 if same else "the behaviour has changed")
PYTHON
