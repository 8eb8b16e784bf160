#!/usr/bin/env bash
# zenoh takes bytes and bytearray as a payload, but no memoryview.
#
# Version: eclipse-zenoh 1.10.2, Python 3.11.
# Expected: everything with Python's buffer protocol can be sent, as none of it needs a copy in Python.
# Behaviour: a memoryview is refused with a TypeError, so a read-only view of a picture has to be copied into bytes once
#   more before zenoh copies it.
# Output:
#   bytes: 3 bytes
#   bytearray: 3 bytes
#   memoryview: TypeError
# What we do: hw_interface.ros2.publishing makes bytes of each message; recordings take the view as it is.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check eclipse-zenoh==1.10.2
"$folder/venv/bin/python" - <<'PYTHON'
import zenoh


def taken(payload):
    """How many bytes are sent of a payload; the name of the error where it is refused."""
    try:
        return f"{len(zenoh.ZBytes(payload))} bytes"
    except TypeError as error:
        return type(error).__name__


seen = {type(p).__name__: taken(p) for p in (b"abc", bytearray(b"abc"), memoryview(b"abc"))}
for name, what in seen.items():
    print(f"{name}: {what}")
expected = {"bytes": "3 bytes", "bytearray": "3 bytes", "memoryview": "TypeError"}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
