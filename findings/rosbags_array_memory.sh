#!/usr/bin/env bash
# rosbags writes the memory of an array as it is, whatever kind of numbers the array holds.
#
# Version: rosbags 0.11.9, numpy 2.4.6, Python 3.11.
# Expected: an array that does not fit a field of float64[] is converted, or refused.
# Behaviour: whole numbers of 64 bits, and floating point numbers of the other byte order, are written as their memory
#   is; a reader sees other numbers. Numbers of 32 bits and every second element of an array are refused.
# Output:
#   float64 [1.0, 2.0] -> [1.0, 2.0]
#   int64 [1, 2] -> [5e-324, 1e-323]
#   big-endian [1.0, 2.0] -> [3.03865e-319, 3.16e-322]
#   float32 [1.0, 2.0] -> ValueError
#   every second of float64 -> ValueError
# What we do: perception.ros2.messages.numbers makes contiguous float64 of everything first.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check rosbags==0.11.9 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
kind = "sensor_msgs/msg/JointState"


def written(values):
    """What a reader sees of positions that were written; the name of the error where they were refused."""
    header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](0, 0), "")
    nothing = np.empty(0)
    try:
        data = store.serialize_cdr(store.types[kind](header, [], values, nothing, nothing), kind)
    except ValueError as error:
        return type(error).__name__
    return store.deserialize_cdr(data, kind).position.tolist()


plain = np.array([1.0, 2.0])
seen = {
    "float64 [1.0, 2.0]": written(plain),
    "int64 [1, 2]": written(plain.astype(np.int64)),
    "big-endian [1.0, 2.0]": written(plain.astype(">f8")),
    "float32 [1.0, 2.0]": written(plain.astype(np.float32)),
    "every second of float64": written(np.arange(4.0)[::2]),
}
for name, values in seen.items():
    print(f"{name} -> {values}")
expected = {
    "float64 [1.0, 2.0]": [1.0, 2.0],
    "int64 [1, 2]": np.array([1, 2]).view(np.float64).tolist(),
    "big-endian [1.0, 2.0]": plain.byteswap().tolist(),
    "float32 [1.0, 2.0]": "ValueError",
    "every second of float64": "ValueError",
}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
