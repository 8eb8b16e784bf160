"""Ways to break one limit of the control box each, and nothing else, starting from a motion that breaks none."""

from dataclasses import dataclass

import numpy as np

from benchmarks.robot_side.libfranka_motions import along, swing
from control.robot.limits import RobotLimits
from control.trajectory.samples import SAMPLE_TIME


@dataclass(frozen=True)
class Motion:
    """A validated motion.

    Attributes:
        name: Task and seed.
        samples: As retimed, in [rad], shape (n, 7), one a millisecond.
        first_stop: Row at which the arm first rests.
        raw: The same path at the planner's timing, shape (m, 7).
    """

    name: str
    samples: np.ndarray
    first_stop: int
    raw: np.ndarray


@dataclass(frozen=True)
class Broken:
    """A motion with one limit broken.

    Attributes:
        expected: Name of the error.
        samples: To play, shape (n, 7); None where torques are played.
        torques: Joint torques in [Nm] of an external controller, shape (n, 7), or None.
        fault: Line for the administrative channel, and the row at which it is sent; None for none.
    """

    expected: str
    samples: np.ndarray | None = None
    torques: np.ndarray | None = None
    fault: tuple[str, int] | None = None


def beyond_position(motion: Motion, limits: RobotLimits, rng: np.random.Generator) -> Broken:
    """After the first stop, one joint goes on past its end at half its speed."""
    begun = motion.samples[: motion.first_stop + 1]
    joint = int(rng.choice([0, 6]))  # these two turn all the way without the arm touching itself
    end = (limits.q_min if rng.random() < 0.5 else limits.q_max)[joint]
    way = end - begun[-1, joint] + np.sign(end) * rng.uniform(0.01, 0.1)
    seconds = 2.19 * abs(way) / (0.5 * limits.qd[joint])
    seconds = max(seconds, np.sqrt(7.6 * abs(way) / (0.5 * limits.qdd[joint])))
    on = swing(begun[-1], along(joint + 1, float(way)), float(seconds))
    return Broken("joint_motion_generator_position_limits_violation", np.concatenate([begun, on[1:]]))


def beyond_velocity(motion: Motion, limits: RobotLimits, rng: np.random.Generator) -> Broken:
    """After the first stop, one joint swings at 1.05 to 1.3 times its speed, at most 0.9 of its acceleration."""
    begun = motion.samples[: motion.first_stop + 1]
    joint = int(rng.choice([0, 6]))
    speed = rng.uniform(1.05, 1.3) * limits.qd[joint]
    way = 1.75 * speed**2 / (0.9 * limits.qdd[joint])
    towards = -1.0 if begun[-1, joint] > 0.0 else 1.0
    on = swing(begun[-1], along(joint + 1, towards * float(way)), float(2.1875 * way / speed))
    return Broken("joint_motion_generator_velocity_limits_violation", np.concatenate([begun, on[1:]]))


def beyond_acceleration(motion: Motion, limits: RobotLimits, rng: np.random.Generator) -> Broken:
    """At the first stop, one joint makes a short smooth step at 1.05 to 1.5 times its acceleration."""
    begun = motion.samples[: motion.first_stop + 1]
    joint = int(rng.integers(7))
    seconds = 0.08
    way = rng.uniform(1.05, 1.5) * limits.qdd[joint] * seconds**2 / 7.5
    towards = -1.0 if begun[-1, joint] > (limits.q_min + limits.q_max)[joint] / 2 else 1.0
    on = swing(begun[-1], along(joint + 1, towards * float(way)), seconds)
    return Broken("joint_motion_generator_velocity_discontinuity", np.concatenate([begun, on[1:]]))


def beyond_jerk(motion: Motion, limits: RobotLimits, rng: np.random.Generator) -> Broken:
    """At one row, one joint is out of its place by so little that only the third difference shows it."""
    q = np.array(motion.samples)
    joint = int(rng.integers(7))
    acceleration = np.abs(np.diff(q[:, joint], 2)) / SAMPLE_TIME**2
    calm = np.flatnonzero(acceleration < 0.2 * limits.qdd[joint])
    row = int(rng.choice(calm[(calm > 10) & (calm < len(q) - 10)])) + 2
    # 1.2 times the jerk limit, with what the motion itself has at most; 0.65 of the acceleration limit.
    q[row, joint] += rng.choice([-1.0, 1.0]) * 1.3 * limits.qddd[joint] * SAMPLE_TIME**3
    return Broken("joint_motion_generator_acceleration_discontinuity", q)


def wrong_start(motion: Motion, limits: RobotLimits, rng: np.random.Generator) -> Broken:
    """The motion begins elsewhere than the box stands."""
    offset = rng.uniform(-0.1, 0.1, 7)
    offset[int(rng.integers(7))] = rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.1)
    return Broken("joint_position_motion_generator_start_pose_invalid", motion.samples + offset)


def end_at_speed(motion: Motion, limits: RobotLimits, rng: np.random.Generator) -> Broken:
    """The motion is called finished while the arm moves."""
    speed = np.abs(np.diff(motion.samples, axis=0)).max(axis=1) / SAMPLE_TIME
    row = int(rng.choice(np.flatnonzero(speed > 0.2)))
    return Broken("joint_motion_generator_velocity_discontinuity", motion.samples[: row + 2])


def lost_packets(motion: Motion, limits: RobotLimits, rng: np.random.Generator) -> Broken:
    """Twenty commands in a row are lost, at rest: only their number is wrong."""
    begun = motion.samples[: motion.first_stop + 1]
    held = np.concatenate([begun, np.tile(begun[-1], (200, 1))])
    row = len(begun) + int(rng.integers(50, 100))
    return Broken("communication_constraints_violation", held, fault=(f"drop {int(rng.integers(20, 40))}", row))


def blow(motion: Motion, limits: RobotLimits, rng: np.random.Generator) -> Broken:
    """Something pushes one joint of the moving arm harder than the threshold."""
    joint, torque = int(rng.integers(1, 5)), float(rng.choice([-1, 1]) * rng.uniform(55.0, 80.0))
    row = int(rng.integers(50, motion.first_stop))
    return Broken("joint_reflex", motion.samples, fault=(f"push {joint} {torque:g} 0.2", row))


def torque_jump(motion: Motion, limits: RobotLimits, rng: np.random.Generator) -> Broken:
    """An external controller's torque jumps by 1.1 to 3 times what a millisecond allows."""
    joint = int(rng.integers(7))
    jump = rng.choice([-1, 1]) * rng.uniform(1.1, 3.0) * limits.taud[joint] * SAMPLE_TIME
    torque = np.concatenate([np.zeros(int(rng.integers(10, 40))), np.full(20, jump)])
    return Broken("controller_torque_discontinuity", torques=torque[:, None] * along(joint + 1, 1.0))


def torque_beyond_range(motion: Motion, limits: RobotLimits, rng: np.random.Generator) -> Broken:
    """An external controller's torque grows beyond what a wrist's drive gives, at less than the allowed rate."""
    joint = int(rng.integers(4, 7))
    torque = np.arange(0.0, limits.tau[joint] + 6.0, rng.uniform(0.7, 0.95))
    towards = float(rng.choice([-1, 1]))
    return Broken("tau_J_range_violation", torques=towards * torque[:, None] * along(joint + 1, 1.0))


BREAKS = (
    beyond_position,
    beyond_velocity,
    beyond_acceleration,
    beyond_jerk,
    wrong_start,
    end_at_speed,
    lost_packets,
    blow,
    torque_jump,
    torque_beyond_range,
)
