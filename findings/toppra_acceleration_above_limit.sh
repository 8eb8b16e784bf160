#!/usr/bin/env bash
# A trajectory of toppra goes a tenth above its acceleration limits, however many gridpoints it has.
#
# Version: toppra 0.6.10, scipy 1.17.1, numpy 2.4.6, Python 3.11.
# Expected: limits hold, but for an error that vanishes as the gridpoints get closer, as the constraints are checked at
#   the gridpoints.
# Behaviour: the default, "ParametrizeSpline", puts a cubic spline through the positions at the times of the gridpoints.
#   It rings where the acceleration jumps, and ringing of a spline does not get smaller with closer points.
#   "ParametrizeConstAccel" comes down to the limit.
# Output (largest acceleration divided by its limit):
#   50 gridpoints: ParametrizeSpline 1.08, ParametrizeConstAccel 1.00
#   400 gridpoints: ParametrizeSpline 1.10, ParametrizeConstAccel 1.00
#   1600 gridpoints: ParametrizeSpline 1.10, ParametrizeConstAccel 1.00
# Remedy: parametrizer="ParametrizeConstAccel", or plan with limits that are a tenth lower, and check the samples.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check toppra==0.6.10 scipy==1.17.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'PYTHON'
import numpy as np
import toppra
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

toppra.setup_logging("ERROR")
path = toppra.SplineInterpolator([0.0, 0.3, 0.6, 1.0], np.array([[0.0, 0.0], [1.0, 0.5], [0.3, 1.2], [1.0, 0.0]]))
limits = np.array([2.0, 3.0])
constraints = [JointVelocityConstraint([1.0, 2.0]), JointAccelerationConstraint(limits)]


def largest(count, parametrizer):
    """Largest acceleration of the trajectory as a part of its limit."""
    grid = np.linspace(0.0, 1.0, count + 1)
    algorithm = TOPPRA(constraints, path, gridpoints=grid, parametrizer=parametrizer)
    trajectory = algorithm.compute_trajectory(0.0, 0.0)
    times = np.linspace(0.0, trajectory.duration, 20_001)
    return round(float(np.max(np.abs(trajectory(times, 2)) / limits)), 2)


seen = {count: [largest(count, f"Parametrize{kind}") for kind in ("Spline", "ConstAccel")] for count in (50, 400, 1600)}
for count, (spline, constant) in seen.items():
    print(f"{count} gridpoints: ParametrizeSpline {spline:.2f}, ParametrizeConstAccel {constant:.2f}")
same = all(spline > 1.05 and constant < 1.01 for spline, constant in seen.values())
raise SystemExit(0 if same else "the behaviour has changed")
PYTHON
