#!/usr/bin/env bash
# rosbags leaves the defaults of fields out of the definitions that it generates, and keeps constants.
#
# Version: rosbags 0.11.9, Python 3.11.
# Expected: the definition of geometry_msgs/msg/Quaternion is that of ROS 2, "float64 w 1"; so is that of a type whose
#   text was parsed and had a default.
# Behaviour: "float64 w". Bytes and type hashes do not depend on defaults; a program that fills missing fields by the
#   definitions in a recording would set w = 0.
# Output:
#   built in: float64 x / float64 y / float64 z / float64 w
#   parsed: int32 LOW=1 / float64 w
# What we do: recordings carry the definitions without defaults; tests compare fields and not defaults.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check rosbags==0.11.9
"$folder/venv/bin/python" - <<'PYTHON'
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
store.register(get_types_from_msg("int32 LOW=1\nfloat64 w 1", "test_msgs/msg/Weight"))
seen = [
    store.generate_msgdef(kind, ros_version=2)[0].splitlines()
    for kind in ("geometry_msgs/msg/Quaternion", "test_msgs/msg/Weight")
]
for name, lines in zip(("built in", "parsed"), seen):
    print(f"{name}: {' / '.join(lines)}")
expected = [["float64 x", "float64 y", "float64 z", "float64 w"], ["int32 LOW=1", "float64 w"]]
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
