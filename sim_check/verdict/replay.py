"""Playing a retimed trajectory in twins: exactly its samples, at the judge's step, with the gripper's own pace."""

from collections.abc import Sequence

import numpy as np

from control.safety.residuals import HeldSpan
from control.simulation.rollouts import Commands, Rollout, gripper_ramp, handled_in, merge_spans, roll_out, squeeze
from control.trajectory.samples import SAMPLE_TIME, Trajectory
from control.twin_model import TwinModel

JUDGE_STEP = 0.002  # [s]; half of the search's, where grasps slip less
SETTLE_SLACK = 0.5  # [s] before the settling time: the servos reach their end and fruit rolls to rest


def replay_commands(trajectory: Trajectory, twin: TwinModel, settle_time: float, step: float = JUDGE_STEP) -> Commands:
    """What servos are told when a trajectory is played.

    Args:
        trajectory: 1 kHz samples and gripper events.
        twin: For the gripper at the start and its stiffness.
        settle_time: Time in [s] that the arm rests after the last sample.
        step: Time between rows in [s], a multiple of a millisecond.
    """
    per_row = round(step / SAMPLE_TIME)
    count = int(np.ceil((len(trajectory.q) - 1) / per_row))
    rows = np.minimum(np.arange(1, count + 1) * per_row, len(trajectory.q) - 1)
    rest = round((settle_time + SETTLE_SLACK) / step)
    rows = np.concatenate([rows, np.full(rest, len(trajectory.q) - 1)])
    speed = trajectory.qd[rows].copy()
    speed[count:] = 0.0
    finger = np.full(len(rows), squeeze(twin, None) if twin.held else twin.gripper_width / 2)
    at = twin.gripper_width / 2
    for event in trajectory.gripper:
        first = round(event.time / step)
        ramp = gripper_ramp(twin, at, event.command, step)
        finger[first:] = ramp[-1]
        stop = min(len(finger), first + len(ramp))
        finger[first:stop] = ramp[: stop - first]
        at = event.command.width / 2
    held, free, handled = [], [], []
    for segment in trajectory.segments:
        start, stop = segment.start // per_row, segment.stop // per_row
        name = handled_in(segment)
        if name is not None:
            handled.append(HeldSpan(name, start, stop))
        if segment.held is None:
            continue
        held.append(HeldSpan(segment.held, start, stop))
        if not segment.touching:
            free.append((start, stop))
    if trajectory.segments and trajectory.segments[-1].held is not None:
        held.append(HeldSpan(trajectory.segments[-1].held, held[-1].stop, len(rows)))
    spans = merge_spans(handled)
    return Commands(trajectory.q[rows], speed, finger, merge_spans(held), tuple(free), handled=spans)


def replay(
    trajectory: Trajectory,
    twins: Sequence[TwinModel],
    settle_time: float,
    nthread: int = 2,
    step: float = JUDGE_STEP,
) -> tuple[list[Rollout], int]:
    """Play one trajectory in several twins of the same layout.

    Args:
        trajectory: What would be played.
        twins: Where; each starts in its own start state.
        settle_time: Time in [s] that the arm rests after the last sample.
        nthread: Threads; the result does not depend on it.
        step: Simulated step in [s].

    Returns:
        One rollout per twin, and the number of simulated steps.
    """
    return roll_out(twins, [replay_commands(trajectory, t, settle_time, step) for t in twins], nthread, step)
