"""What the hand carries, and what that takes: torques of a motion with the load of each of its segments."""

from collections.abc import Callable, Mapping

import numpy as np

from control.path_planning.collision_filter import free_joint_address
from control.robot.dynamics import Payload, RobotModel
from control.safety.trajectory_checks import PADDING
from control.trajectory.samples import SAMPLE_TIME, Trajectory
from control.twin_model import TwinModel

# Time in [s] over which a load goes over to the hand before a segment that holds it, and back after it. The arm is at
# rest then, and fingers close more slowly. How fast a thing's weight passes from table to hand is not in the samples;
# a jump there would count as a rate of torque that no motor sees.
LOAD_TIME = 0.1


def held_payloads(twin: TwinModel) -> dict[str, Payload]:
    """What each object would weigh in the hand: name -> payload, its mass from the twin's model.

    The centre of mass is taken at the tool centre point, as the fingers close about a thing's middle; what is held by
    a handle hangs to one side of it by some centimetres, which is little beside the arm's own reach.
    """
    model = twin.model
    return {
        o.name: Payload(float(model.body_subtreemass[model.body(o.name).id]))
        for o in twin.objects
        if o.movable and free_joint_address(model, o.name) is not None
    }


def loaded_torque(
    robot: RobotModel, trajectory: Trajectory, payloads: Mapping[str, Payload], padding: int = PADDING
) -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """Torques of a trajectory with what each segment holds.

        tau = tau_0 + sum_i share_i (tau_i - tau_0)

    with tau_0 of the empty hand, tau_i with object i in it (torques are linear in the inertia of a load) and share_i
    from 0 to 1: 1 where a segment holds it, rising before and falling after over `LOAD_TIME`.

    Args:
        robot: With whatever is in or on the hand all the time.
        trajectory: For its segments.
        payloads: Of the objects, by the names that segments hold; others weigh nothing.
        padding: Rows of rest before and after the trajectory's samples.

    Returns:
        A function of q, qd and qdd, each with one row per sample and `padding` more at each end, to torques in [Nm].
    """
    count = len(trajectory.q)
    held = {s.held for s in trajectory.segments if s.held is not None and s.held in payloads}
    shares = {name: load_share(trajectory, name) for name in sorted(held)}
    loaded = {name: robot.with_payload(payloads[name]) for name in shares}

    def torque(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        if len(q) != count + 2 * padding:
            raise ValueError(f"torques of {len(q)} rows were asked for; this trajectory has {count} + 2 * {padding}")
        empty = robot.torque(q, qd, qdd)
        tau = empty.copy()
        for name, share in shares.items():
            weight = np.pad(share, padding, mode="edge")[:, None]
            rows = np.flatnonzero(weight)
            tau[rows] += weight[rows] * (loaded[name].torque(q[rows], qd[rows], qdd[rows]) - empty[rows])
        return tau

    return torque


def load_share(trajectory: Trajectory, name: str) -> np.ndarray:
    """How much of an object's load the hand carries at each sample, 0..1, shape (n,)."""
    samples = np.arange(len(trajectory.q))
    share = np.zeros(len(samples))
    for segment in trajectory.segments:
        if segment.held == name:
            outside = np.maximum(np.maximum(segment.start - samples, samples - (segment.stop - 1)), 0)
            share = np.maximum(share, 1.0 - outside * SAMPLE_TIME / LOAD_TIME)
    return share
