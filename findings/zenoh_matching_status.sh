#!/usr/bin/env bash
# A publisher's matching_status is typed as a bool, and is an object that is always true.
#
# Version: eclipse-zenoh 1.10.2, Python 3.11.
# Expected: the type file that comes with the wheel says "def matching_status(self) -> bool", so that "if
#   publisher.matching_status:" asks whether anybody listens.
# Behaviour: it is a MatchingStatus with a field "matching". The object itself is true although nobody listens, and
#   type checkers refuse the right question.
# Output:
#   typed: bool
#   returned: MatchingStatus
#   true as a condition: True
#   somebody listens: False
# Remedy: ask publisher.matching_status.matching, with the type checker's complaint silenced on that line.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check eclipse-zenoh==1.10.2
"$folder/venv/bin/python" - <<'PYTHON'
import pathlib
import re

import zenoh

typed = next(
    found.group(1)
    for file in sorted(pathlib.Path(zenoh.__file__).parent.glob("*.pyi"))
    if (found := re.search(r"def matching_status\(self\) -> (\w+)", file.read_text()))
)
config = zenoh.Config()
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("listen/endpoints", "[]")
with zenoh.open(config) as session:
    status = session.declare_publisher("cell/state").matching_status
    seen = {
        "typed": typed,
        "returned": type(status).__name__,
        "true as a condition": bool(status),
        "somebody listens": status.matching,
    }
for name, what in seen.items():
    print(f"{name}: {what}")
expected = ["bool", "MatchingStatus", True, False]
raise SystemExit(0 if list(seen.values()) == expected else "the behaviour has changed")
PYTHON
