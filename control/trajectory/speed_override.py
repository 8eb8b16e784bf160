"""Speed override: playing the rest of a trajectory at another share of its own speed, exactly on its path.

Needs numpy only. A verdict covers a trajectory at its own speed, so only slower is allowed. That slower keeps every
limit follows from `control.trajectory.change_of_rate`: at a constant rate r speeds scale with r, accelerations with
r^2, jerks with r^3, and torques come nearer to what gravity alone asks for. That slower also does what was judged is an
assumption, and holds for motions that grasp, carry and place with friction and gravity alone: the arm rests at each
gripper event, whose dwell only gets longer; contacts are touched more gently; nothing is thrown or caught. It does
not hold where something else moves in the scene meanwhile, which is why a result may not last as long as one likes.
"""

import numpy as np

from control.errors import TrajectoryError
from control.robot.limits import RobotLimits
from control.trajectory.change_of_rate import Torque, changes, keeps_limits
from control.trajectory.playback import PROGRESS, RATE, Playback, check_rate, steady
from control.trajectory.samples import SAMPLE_TIME

MOST_ROWS = 300_000  # five minutes: longer than that nobody vouches for a scene that was seen once


def override_speed(
    playback: Playback, index: int, rate: float, limits: RobotLimits, torque: Torque | None = None
) -> Playback:
    """The same motion with its rest at another rate, reached by the jerk-limited change that is over soonest.

    Args:
        playback: What is being commanded; it keeps the limits itself.
        index: Row that was commanded last.
        rate: Share of the trajectory's own speed, above 0 and at most 1.
        limits: Limits of position, velocity, acceleration and jerk, which every row after `index` keeps by finite
            differences with the rows before it; those of torque and torque rate are kept, too, with `torque`.
        torque: (q, qd, qdd), each of shape (n, 7), to torques in [Nm] of the same shape.

    Returns:
        What to command instead: the same up to row `index` (and some rows more, where a change cannot begin at once),
        then the change, then the rest of the trajectory at that rate.

    Raises:
        TrajectoryError: The rate is not in (0, 1], the motion would last too long, `index` is outside the playback,
            or no change of the rate keeps the limits.
    """
    check_rate(rate)
    end, last = len(playback.trajectory.q) - 1, len(playback.q) - 1
    if not 0 <= index <= last:
        raise TrajectoryError(f"cannot change the speed at sample {index}; what is commanded has samples 0 to {last}")
    check_length(end - float(playback.clock[index, PROGRESS]), rate, index)
    if playback.clock[index, RATE] == rate and not np.any(playback.clock[index:, RATE] != rate):
        return playback
    for begin, change in reversed(list(changes(playback, index, rate, limits, torque))):
        clock = np.concatenate([change, steady(change[-1, PROGRESS], rate, end)])
        result = playback.continued(begin, clock)
        if keeps_limits(result, begin, result.q[begin + 1 :], limits, torque):
            return result
    raise TrajectoryError(
        f"no change from speed {playback.clock[index, RATE]:.3g} to {rate:g} keeps the limits of acceleration and jerk "
        "from here; the speed stays, ask again a moment later or stop"
    )


def check_length(samples: float, rate: float, played: int = 0) -> None:
    """Refuse a rate at which a motion would last too long.

    Args:
        samples: Samples of the trajectory that are left.
        rate: At which they would be played, above 0.
        played: Rows that were commanded before.

    Raises:
        TrajectoryError: Longer than a scene that was seen once is vouched for.
    """
    if played + samples / rate > MOST_ROWS:
        least = samples / max(1, MOST_ROWS - played)
        raise TrajectoryError(
            f"at speed {rate:g} the motion would last {(played + samples / rate) * SAMPLE_TIME:.0f} s; at most "
            f"{MOST_ROWS * SAMPLE_TIME:.0f} s are played on what was seen once: ask for {least:.2g} or more, or stop"
        )
