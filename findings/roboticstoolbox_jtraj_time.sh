#!/usr/bin/env bash
# Times and velocities of one jtraj trajectory of the Robotics Toolbox do not belong together.
#
# Version: roboticstoolbox-python 1.5.0, numpy 2.4.6, Python 3.11.
# Expected: with a number of steps, time goes from 0 to 1, as the page of jtraj says; or by one for each step, as it
#   does for quintic. Either way the velocity, summed over the time, is the way.
# Behaviour: velocities are those for a time from 0 to 1. The times in the same object go from 0 to N over N points,
#   so a step is N/(N-1). quintic, the same polynomial, has times and velocities in steps.
# Output (from 0 to 1 in 11 steps):
#   jtraj: times 0.0 to 11.0, largest velocity 1.875, velocity summed over time 11.0
#   quintic: times 0.0 to 10.0, largest velocity 0.1875, velocity summed over time 1.0
# Remedy: give jtraj a time vector in seconds.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check roboticstoolbox-python==1.5.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
from roboticstoolbox import jtraj, quintic

seen = {}
for name, trajectory in (("jtraj", jtraj([0.0], [1.0], 11)), ("quintic", quintic(0.0, 1.0, 11))):
    times, speeds = np.asarray(trajectory.t, dtype=float), np.asarray(trajectory.qd, dtype=float).ravel()
    numbers = times[0], times[-1], speeds.max(), np.trapezoid(speeds, times)
    seen[name] = [round(float(number), digits) for number, digits in zip(numbers, (3, 3, 4, 2))]
for name, (begin, end, speed, way) in seen.items():
    print(f"{name}: times {begin} to {end}, largest velocity {speed}, velocity summed over time {way}")
expected = {"jtraj": [0.0, 11.0, 1.875, 11.0], "quintic": [0.0, 10.0, 0.1875, 1.0]}
raise SystemExit(0 if seen == expected else "the behaviour has changed")
PYTHON
