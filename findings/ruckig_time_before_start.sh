#!/usr/bin/env bash
# ruckig continues a trajectory backwards before its start by the first jerk, and forwards after its end without it.
#
# Version: ruckig 0.19.4 (community version, all computed locally), Python 3.11.
# Expected: before the start the joint rests at its start, as it rests at its target after the end; or an error is
#   raised.
# Behaviour: one second before the start a joint at rest is said to be 1.67 away with an acceleration of -10, ten times
#   its limit. After the end it rests. A clock that starts a little late makes such a time.
# Output (position, velocity, acceleration):
#   1 s before the start: [-1.667, 5.0, -10.0]
#   at the start: [0.0, 0.0, 0.0]
#   1 s after the end: [1.0, 0.0, 0.0]
# Remedy: clamp the time to the duration of the trajectory before asking.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check ruckig==0.19.4
"$folder/venv/bin/python" - <<'PYTHON'
import ruckig

question = ruckig.InputParameter(1)
question.current_position, question.target_position = [0.0], [1.0]
question.max_velocity, question.max_acceleration, question.max_jerk = [1.0], [1.0], [10.0]
answer = ruckig.Trajectory(1)
ruckig.Ruckig(1).calculate(question, answer)
seen = {
    name: [round(value[0], 3) + 0.0 for value in answer.at_time(time)]
    for name, time in (
        ("1 s before the start", -1.0),
        ("at the start", 0.0),
        ("1 s after the end", answer.duration + 1.0),
    )
}
for name, state in seen.items():
    print(f"{name}: {state}")
expected = [[-1.667, 5.0, -10.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
raise SystemExit(0 if list(seen.values()) == expected else "the behaviour has changed")
PYTHON
