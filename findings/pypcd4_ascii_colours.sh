#!/usr/bin/env bash
# The colours of a point cloud are gone after pypcd4 has written it as an ascii PCD file.
#
# Version: pypcd4 1.5.1, numpy 2.4.6, Python 3.11.
# Expected: the three encodings of a PCD file hold the same cloud, to some digits.
# Behaviour: the three bytes of a colour are kept in the bits of a float32, which is then of the size 1e-38. The ascii
#   writer gives ten digits after the point, so every colour is 0.0000000000. Coordinates are kept, nothing is said.
# Output (colour of the first point, written 200 100 50):
#   binary: 200 100 50
#   binary_compressed: 200 100 50
#   ascii: 0 0 0
# Remedy: write binary files; in text keep colours in fields of integers.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pypcd4==1.5.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import pathlib
import tempfile

import numpy as np
from pypcd4 import Encoding, PointCloud

places = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], dtype=np.float32)
packed = PointCloud.encode_rgb(np.array([[200, 100, 50], [1, 2, 3]], dtype=np.uint8))
cloud = PointCloud.from_xyzrgb_points(np.hstack([places, packed.reshape(-1, 1)]))
seen = {}
with tempfile.TemporaryDirectory() as folder:
    for encoding in ("binary", "binary_compressed", "ascii"):
        path = pathlib.Path(folder, "cloud.pcd")
        cloud.save(path, encoding=Encoding(encoding))
        back = PointCloud.from_path(path)
        assert np.allclose(back.numpy(("x", "y", "z")), places)
        seen[encoding] = PointCloud.decode_rgb(back.pc_data["rgb"])[0].tolist()
for encoding, colour in seen.items():
    print(f"{encoding}: {' '.join(map(str, colour))}")
expected = {"binary": [200, 100, 50], "binary_compressed": [200, 100, 50], "ascii": [0, 0, 0]}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
