#!/usr/bin/env bash
# ruckig's position extrema leave out the braking that precedes a trajectory which starts too fast.
#
# Version: ruckig 0.19.4 (community version, all computed locally), Python 3.11.
# Expected: position_extrema bound the whole trajectory, so that they can be compared with the limits of a joint.
# Behaviour: a start above the velocity limit is first braked. The extrema begin after that phase: they promise at most
#   1.65, and the joint goes to 2.10. The calculation says "Working", as it does for a start inside the limits.
# Output:
#   result: Result.Working
#   position_extrema: 1.65
#   highest sampled: 2.10
#   within limits: 0.00 said 1.00, sampled 1.00
# Remedy: sample a trajectory for its extrema.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check ruckig==0.19.4
"$folder/venv/bin/python" - <<'PYTHON'
import ruckig


def extrema(velocity):
    """Result, highest position by position_extrema, and highest position of 4001 samples."""
    question = ruckig.InputParameter(1)
    question.current_position, question.current_velocity = [0.0], [velocity]
    question.target_position = [1.0]
    question.max_velocity, question.max_acceleration, question.max_jerk = [1.0], [1.0], [10.0]
    answer = ruckig.Trajectory(1)
    result = ruckig.Ruckig(1).calculate(question, answer)
    sampled = max(answer.at_time(answer.duration * i / 4000)[0][0] for i in range(4001))
    return result, round(answer.position_extrema[0].max, 2), round(sampled, 2)


result, said, sampled = extrema(2.0)
_, plain_said, plain_sampled = extrema(0.0)
print(f"result: {result}")
print(f"position_extrema: {said:.2f}")
print(f"highest sampled: {sampled:.2f}")
print(f"within limits: 0.00 said {plain_said:.2f}, sampled {plain_sampled:.2f}")
same = (result, said, sampled) == (ruckig.Result.Working, 1.65, 2.1) and plain_said == plain_sampled == 1.0
raise SystemExit(0 if same else "the behaviour has changed")
PYTHON
