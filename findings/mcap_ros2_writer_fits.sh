#!/usr/bin/env bash
# The ROS 2 writer of mcap makes data fit the definition without a word, but refuses arrays of numpy.
#
# Version: mcap-ros2-support 0.6.0, mcap 1.6.0, numpy 2.4.6, Python 3.11.
# Expected: a field that the definition does not have, or an array of the wrong length, is refused; an array of numpy
#   is taken for float64[].
# Behaviour: an unknown field is left out and the one that was meant gets its default; arrays of fixed length are cut
#   or filled with zeros; bounded arrays are cut, bounded strings are not; 1.7 becomes 1 in an int32.
# Output:
#   misspelt field: positon=5.0 -> position=0.0
#   float64[3] of four: [1.0, 2.0, 3.0]
#   float64[3] of one: [1.0, 0.0, 0.0]
#   int32[<=2] of three: [1, 2]
#   string<=3 of five: hello
#   int32 of 1.7: 1
#   float64[] from numpy: ValueError
# Remedy: check names and lengths before writing, and call tolist(); or write with rosbags, whose types refuse unknown
#   names.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mcap-ros2-support==0.6.0 mcap==1.6.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import io

import numpy as np
from mcap_ros2.reader import read_ros2_messages
from mcap_ros2.writer import Writer


def written(definition, message):
    """What a reader sees in the only field of a message; the name of the error where it was refused."""
    memory = io.BytesIO()
    writer = Writer(memory)
    schema = writer.register_msgdef("example_msgs/msg/Example", definition)
    try:
        writer.write_message("/example", schema, message, log_time=0, publish_time=0)
    except ValueError as error:
        return type(error).__name__
    writer.finish()
    memory.seek(0)
    read = next(iter(read_ros2_messages(memory))).ros_msg
    return getattr(read, definition.split()[1])


seen = {
    "misspelt field: positon=5.0 -> position=": written("float64 position", {"positon": 5.0}),
    "float64[3] of four: ": written("float64[3] a", {"a": [1.0, 2.0, 3.0, 4.0]}),
    "float64[3] of one: ": written("float64[3] a", {"a": [1.0]}),
    "int32[<=2] of three: ": written("int32[<=2] a", {"a": [1, 2, 3]}),
    "string<=3 of five: ": written("string<=3 a", {"a": "hello"}),
    "int32 of 1.7: ": written("int32 a", {"a": 1.7}),
    "float64[] from numpy: ": written("float64[] a", {"a": np.zeros(3)}),
}
for name, what in seen.items():
    print(f"{name}{what}")
expected = [0.0, [1.0, 2.0, 3.0], [1.0, 0.0, 0.0], [1, 2], "hello", 1, "ValueError"]
raise SystemExit(0 if list(seen.values()) == expected else "the behaviour has changed")
PYTHON
