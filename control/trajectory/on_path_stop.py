"""Coming to rest on the path: slows the clock of a trajectory down to zero instead of leaving its path.

A stop is a change of rate to 0 (`control.trajectory.change_of_rate`). When the trajectory's own end comes first, the
arm rests there. Needs numpy only: a robot-side process stops on its own.
"""

import numpy as np

from control.errors import TrajectoryError
from control.robot.limits import RobotLimits
from control.trajectory.change_of_rate import HISTORY, changes, keeps_limits
from control.trajectory.playback import RATE, SLOPE, Playback


def stop_on_path(playback: Playback, index: int, limits: RobotLimits) -> Playback:
    """The shortest way to rest on the trajectory's own path, from any rate and in the middle of a change of it.

    Args:
        playback: What is being commanded; it keeps the limits itself.
        index: Row that was commanded last.
        limits: Published limits of position, velocity, acceleration and jerk, which every row keeps by finite
            differences with the rows before it. Torques follow from the acceleration limits and are not looked at.

    Returns:
        What to command instead: the same up to row `index`, and at least one row after it; it ends at rest. A fall
        that cannot begin at once without breaking a limit begins as soon as it can; without any, the playback itself
        is returned.

    Raises:
        TrajectoryError: `index` is outside the playback.
    """
    end = len(playback.q) - 1
    if not 0 <= index <= end:
        raise TrajectoryError(f"cannot stop at sample {index}; what is commanded has samples 0 to {end}")
    stay = playback.q[index : index + 1]
    if keeps_limits(playback, index, np.repeat(stay, HISTORY, axis=0), limits):
        clock = playback.clock[index : index + 1].copy()
        clock[:, [RATE, SLOPE]] = 0.0
        return playback.continued(index, clock, stay)
    begin, clock = next(changes(playback, index, 0.0, limits), (index, None))
    return playback if clock is None else playback.continued(begin, clock)
