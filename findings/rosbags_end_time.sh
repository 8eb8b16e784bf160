#!/usr/bin/env bash
# The end and the duration of a recording in rosbags are a nanosecond more than those in its own metadata file.
#
# Version: rosbags 0.11.9, Python 3.11.
# Expected: end_time is the time of the last message and duration is what metadata.yaml says.
# Behaviour: end_time is the first time after the last message, as the end of a selection is exclusive. Asking for
#   messages up to the time of the last one leaves that one out.
# Output:
#   times: 10 20 30
#   end_time 31, duration 21, metadata 20
#   messages(start=10, stop=30): 10 20
# Remedy: subtract one for the time of the last message; add one to an inclusive end.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check rosbags==0.11.9
"$folder/venv/bin/python" - <<'PYTHON'
import pathlib
import tempfile

from rosbags.rosbag2 import Reader, Writer
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
kind = "std_msgs/msg/String"
with tempfile.TemporaryDirectory() as folder:
    place = pathlib.Path(folder) / "recording"
    with Writer(place, version=9) as writer:
        connection = writer.add_connection("/words", kind, typestore=store)
        for time in (10, 20, 30):
            writer.write(connection, time, store.serialize_cdr(store.types[kind]("word"), kind))
    lines = (line.strip() for line in (place / "metadata.yaml").read_text().splitlines())
    metadata = next(int(line.split()[1]) for line in lines if line.startswith("nanoseconds:"))
    with Reader(place) as reader:
        end, duration = reader.end_time, reader.duration
        every = [time for _, time, _ in reader.messages()]
        chosen = [time for _, time, _ in reader.messages(start=10, stop=30)]
print("times:", *every)
print(f"end_time {end}, duration {duration}, metadata {metadata}")
print("messages(start=10, stop=30):", *chosen)
same = (every, end, duration, metadata, chosen) == ([10, 20, 30], 31, 21, 20, [10, 20])
raise SystemExit(0 if same else "the behaviour has changed")
PYTHON
