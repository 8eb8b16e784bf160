"""Plain predictive sampling, the baseline that structured candidates are held against.

It knows neither grasps nor collisions: what it knows of the goal is `control.planners.sampling_cost`, how it searches
is `control.planners.spline_sampler`. It ends when the primary term is met and stays met at rest, or when its simulated
time is up.
"""

import time

import numpy as np

from control.planners.result import MotionPlan, MotionStats
from control.planners.sampling_cost import RunningCost
from control.planners.spline_sampler import SamplingSettings, SplineSampler
from control.robot.kinematics import ArmKinematics
from control.safety.limits import SafetyLimits
from control.simulation.batches import Observer
from control.simulation.closed_loop import ClosedLoop
from control.simulation.executed_motion import joint_path
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import PALM, RewardSpec
from control.tasks.subtasks import read_subtask, unseen
from control.twin_model import TwinModel


def plan_by_sampling(
    twin: TwinModel,
    spec: RewardSpec,
    safety: SafetyLimits,
    rng: np.random.Generator,
    kinematics: ArmKinematics | None = None,
    nthread: int = 2,
    observe: Observer | None = None,
    settings: SamplingSettings | None = None,
) -> MotionPlan | FailureCause:
    """Find a motion that meets a spec's primary term in the twin by predictive sampling.

    Args:
        twin: What is believed to stand around.
        spec: What to achieve.
        safety: The safety table; only its workspace costs anything here.
        rng: Source of randomness; the same state gives the same plan at any number of threads.
        kinematics: The arm; read from its URDF when left out.
        nthread: Threads for simulation.
        observe: Told of each batch of motions that is simulated.
        settings: Of the method.

    Returns:
        The plan, which may well break safety checks: they are for the verdict to find. Its counts say whether the
        path, played from rest to rest, met the term once more (`path_meets`). Or why there is none: `not_seen`, or
        `no_candidate` with how near the motion came.

    Raises:
        RewardSpecError: A term is of a kind that is not supported yet.
    """
    began = time.perf_counter()
    task = read_subtask(spec)
    missing = unseen(twin, spec)
    if missing is not None:
        return missing
    settings = settings or SamplingSettings()
    arm = kinematics or ArmKinematics.from_urdf()
    loop = ClosedLoop(twin, spec, task, nthread, observe)
    sampler = SplineSampler(
        twin, RunningCost(twin, spec, task, safety, arm, loop.rest_palm, settings.weights), settings
    )
    while not loop.done() and loop.time < settings.time_limit:
        sampler.follow_best(loop, rng)
    counts = {"replans": sampler.replans, "rollouts": sampler.replans * settings.trajectories}
    if not loop.finished:
        stats = MotionStats(loop.steps, time.perf_counter() - began, counts)
        return _out_of_time(loop, sampler.replans, settings, stats)
    path = joint_path(twin, loop.pieces, loop.opening)
    counts["path_meets"] = int(loop.met_by(path))
    stats = MotionStats(loop.steps, time.perf_counter() - began, counts)
    text = f"predictive sampling: {loop.time:.1f} s, {sampler.replans} re-plans; {loop.judge().text}"
    return MotionPlan(path, text, sampler.cost, stats)


def _out_of_time(loop: ClosedLoop, replans: int, settings: SamplingSettings, stats: MotionStats) -> FailureCause:
    """How near the motion came."""
    task, last = loop.task, loop.judge()
    unit = "of the joint's range" if task.manipulation == "drive" else "m"
    return FailureCause(
        "no_candidate",
        task.subject or task.target or PALM,
        f"predictive sampling did not reach the goal in {loop.time:.1f} s of simulated motion ({replans} re-plans of "
        f"{settings.trajectories} trajectories); it came nearest after {loop.nearest_at:.1f} s: {loop.nearest.text}",
        evidence={
            "counts": stats.counts,
            "steps": stats.steps,
            "seconds": stats.seconds,
            "simulated_time": loop.time,
            "left_at_start": loop.at_start.residual,
            "left_at_nearest": loop.nearest.residual,
            "nearest_at": loop.nearest_at,
            "left_at_end": last.residual,
            "unit": unit,
        },
    )
