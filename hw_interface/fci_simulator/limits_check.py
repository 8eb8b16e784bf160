"""Which limit a command breaks, by the name that the control box gives it.

Limits, and which of them are necessary conditions: Franka Control Interface documentation, "Robot and interface
specifications". A violated acceleration limit is called a velocity discontinuity, a violated jerk limit an
acceleration discontinuity, because that is how a jump of the command shows itself.
"""

import numpy as np

from control.robot.limits import RobotLimits
from control.trajectory.samples import SAMPLE_TIME
from hw_interface.fci_simulator.layout import Error
from hw_interface.fci_simulator.set_point import SetPoint

# A first command further from q_d than this in [rad] is a wrong start; nearer, the limits below judge the jump. Not
# published; libfranka's users meet the first name for whole tenths of a radian and the others for small offsets.
START_TOLERANCE = 0.02
# Shares of a limit that rounding of the third difference of q (1e-16 rad * 8 / 1e-9 s^3) never reaches.
ROUNDING = 1.0 + 1e-6
# Where the arm itself may be beyond what may be commanded, since it follows with an error: [rad], and a share of the
# largest speed. Not published.
POSITION_MARGIN = 0.02
SPEED_MARGIN = 1.1


def start_error(first: np.ndarray, set_point: SetPoint) -> Error | None:
    """Whether a joint-position motion may begin at `first` in [rad], shape (7,)."""
    if not np.abs(first - set_point.q).max() <= START_TOLERANCE:
        return Error.START_POSE
    return None


def command_error(q: np.ndarray, set_point: SetPoint, limits: RobotLimits) -> Error | None:
    """The first limit that being at q one millisecond from now breaks, or None.

    Args:
        q: Commanded joint positions in [rad], shape (7,).
        set_point: Where the box is.
        limits: Of the robot.
    """
    if not ((q >= limits.q_min) & (q <= limits.q_max)).all():  # not a number is nowhere
        return Error.COMMANDED_POSITION
    dq, ddq, dddq = set_point.derivatives(q)
    if (np.abs(dq) > limits.qd * ROUNDING).any():
        return Error.COMMANDED_VELOCITY
    if (np.abs(ddq) > limits.qdd * ROUNDING).any():
        return Error.COMMANDED_ACCELERATION
    if (np.abs(dddq) > limits.qddd * ROUNDING).any():
        return Error.COMMANDED_JERK
    return None


def torque_command_error(tau: np.ndarray, before: np.ndarray, limits: RobotLimits) -> Error | None:
    """Whether an external controller's torque jumps; both in [Nm], shape (7,), a millisecond apart."""
    if not (np.abs(tau - before) <= limits.taud * SAMPLE_TIME * ROUNDING).all():  # not a number is a jump too
        return Error.TORQUE_DISCONTINUITY
    return None


def measured_error(q: np.ndarray, dq: np.ndarray, drive: np.ndarray, limits: RobotLimits) -> Error | None:
    """Whether the arm itself is where, or as fast or loaded as, it must not be.

    Args:
        q, dq: Measured, in [rad] and [rad/s], shape (7,).
        drive: Torques that the drives give in [Nm], gravity included, shape (7,).
        limits: Of the robot.
    """
    if (np.abs(dq) > limits.qd * SPEED_MARGIN).any():
        return Error.JOINT_VELOCITY
    if (q < limits.q_min - POSITION_MARGIN).any() or (q > limits.q_max + POSITION_MARGIN).any():
        return Error.JOINT_POSITION_LIMITS
    if (np.abs(drive) > limits.tau).any():
        return Error.TORQUE_RANGE
    return None
