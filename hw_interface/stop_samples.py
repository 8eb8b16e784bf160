"""The samples that bring an arm to rest on its path."""

import numpy as np

from control.limits import RobotLimits
from control.on_path_stop import stop_on_path
from control.trajectory import Trajectory


def stopping_samples(trajectory: Trajectory, sample: int, limits: RobotLimits) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions in [rad] and velocities in [rad/s], shape (n, 7) each, to command instead of `sample` and after.

    The last command was sample - 1.

    Raises:
        TrajectoryError: No stop within the limits was found.
    """
    stop = stop_on_path(trajectory, max(0, sample - 1), limits)
    return stop.q, stop.qd
