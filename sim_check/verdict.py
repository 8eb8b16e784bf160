"""The verdict on a retimed trajectory: every safety check in the nominal twin, its success rate in perturbed ones.

The nominal twin is judged by everything: the samples themselves (`control.trajectory_checks`), the safety residuals
of the replayed motion, clearances, and the reward. A perturbed twin counts as a success when the reward
is met and no residual of the replay is broken; clearances are left out there, as what moved by its own
uncertainty is nearer on one side by right. A motion passes when the nominal twin keeps every check and enough of the
perturbed ones succeed.
"""

from dataclasses import replace

import numpy as np

from control.certificate import CheckResult, Verdict
from control.limits import REST_Q, RobotLimits
from control.residuals import TwinMotion, safety_residuals
from control.rewards import RewardSpec
from control.rewards_cost import judge_terms
from control.robot import RobotModel
from control.rollouts import Rollout, record_motion
from control.safety import SafetyLimits
from control.subtasks import Subtask, palm_at, read_subtask
from control.trajectory import Trajectory
from control.trajectory_checks import check_trajectory
from control.twin_model import TwinModel
from control.workbench import resting_on
from sim_check.replay import measure_clearances, replay
from sim_check.twin import possible_twins

# Least share of perturbed twins that must succeed. A good motion that succeeds nine times in ten gets four of six with
# a probability of 0.98; one that succeeds every other time, with 0.34.
SUCCESS_SHARE = 2 / 3
NOMINAL_STRIDE = 2  # every second state (4 ms) is looked at for contacts
PERTURBED_STRIDE = 5
NORMAL_95 = 1.959964  # quantile of the standard normal distribution for a two-sided 95 % interval


def judge_trajectory(
    trajectory: Trajectory,
    twin: TwinModel,
    spec: RewardSpec,
    safety: SafetyLimits,
    limits: RobotLimits,
    rng: np.random.Generator,
    perturbed: int = 6,
    nthread: int = 2,
    robot: RobotModel | None = None,
    success_share: float = SUCCESS_SHARE,
) -> Verdict:
    """Judge exactly the samples that a robot would play.

    Args:
        trajectory: Retimed, 1 kHz.
        twin: What is believed to stand around.
        spec: What the motion should achieve.
        safety: The safety table.
        limits: Published limits of the robot.
        rng: Source of randomness for the perturbed twins.
        perturbed: Number of perturbed twins; 0 judges by the nominal twin alone.
        nthread: Threads for simulation; the verdict does not depend on it.
        robot: Rigid-body model for torques and the hand's speed; the Panda with the twin's gripper, open, by default.
        success_share: Least share of perturbed twins that must succeed.
    """
    robot = robot or RobotModel.panda(gripper=twin.gripper)
    task = read_subtask(spec)
    twins = [twin, *possible_twins(twin, rng, perturbed)]
    rollouts, steps = replay(trajectory, twins, safety.settle_time, nthread)
    judged = [
        _checks(r, t, spec, task, safety, NOMINAL_STRIDE if i == 0 else PERTURBED_STRIDE, clearances=i == 0)
        for i, (r, t) in enumerate(zip(rollouts, twins, strict=True))
    ]
    checks = (
        *check_trajectory(trajectory, limits, safety, robot.torque, robot.tcp_poses),
        _start_state(trajectory, twin, safety),
        *judged[0],
    )
    successes = sum(all(c.ok for c in trial) for trial in judged[1:])
    # Twins that could not be drawn count against the motion: what cannot be imagined otherwise is not known to be safe.
    enough = successes >= success_share * perturbed - 1e-9
    return Verdict(
        checks=checks,
        successes=successes,
        trials=len(twins) - 1,
        interval=wilson_interval(successes, len(twins) - 1),
        passed=all(c.ok for c in checks) and enough,
        steps=steps,
    )


def wilson_interval(successes: int, trials: int, z: float = NORMAL_95) -> tuple[float, float]:
    """Confidence interval of a success rate.

        (p + z^2 / 2n -+ z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n)

    Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference", 1927.

    Returns:
        (low, high), both in 0..1; (0, 1) without trials.
    """
    if trials == 0:
        return 0.0, 1.0
    p, n = successes / trials, trials
    middle = p + z * z / (2 * n)
    spread = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    scale = 1 + z * z / n
    return float(max(0.0, (middle - spread) / scale)), float(min(1.0, (middle + spread) / scale))


def _checks(
    rollout: Rollout,
    twin: TwinModel,
    spec: RewardSpec,
    task: Subtask,
    safety: SafetyLimits,
    stride: int,
    clearances: bool,
) -> tuple[CheckResult, ...]:
    """Residuals of one replayed motion and its primary reward."""
    if rollout.exploded:
        return (CheckResult("simulation", float("inf"), 0.0, "m", False),)
    start = twin.start()
    handled = task.subject or twin.held
    supports = frozenset(resting_on(twin.model, start, handled)) if handled else frozenset()
    motion = record_motion(rollout, twin, spec, task, supports, stride)
    if clearances:
        near = measure_clearances(rollout, motion.time, twin, spec, safety, task.subject, supports)
        motion = replace(motion, clearances=near)
    return (*(r.check(motion) for r in safety_residuals(safety)), _reward(motion, twin, spec, safety))


def _reward(motion: TwinMotion, twin: TwinModel, spec: RewardSpec, safety: SafetyLimits) -> CheckResult:
    """The reward's terms, at their worst over the settling time: met early and lost again does not count.

    A term that is meant for the way counts at its best moment there.
    """
    rest = palm_at(twin, REST_Q)
    first = int(np.searchsorted(motion.time, motion.time[-1] - safety.settle_time))
    rows = np.unique(np.linspace(first, len(motion.time) - 1, 6).astype(int))
    judged = judge_terms(motion, twin, spec, [int(k) for k in rows], rest)
    worst = max(range(len(judged)), key=lambda i: (judged[i].residual, spec.terms[i].primary))
    lacks = judged[worst].residual
    at, names = float(motion.time[-1]), tuple(sorted(spec.terms[worst].names))
    return CheckResult("reward_met", lacks, 0.0, "m", lacks == 0.0, at, names)


def _start_state(trajectory: Trajectory, twin: TwinModel, safety: SafetyLimits) -> CheckResult:
    """Whether the first sample is where the arm is."""
    off = np.abs(trajectory.q[0] - twin.q)
    joint = int(np.argmax(off))
    worst = float(off[joint])
    return CheckResult(
        "start_state",
        worst,
        safety.start_tolerance,
        "rad",
        worst <= safety.start_tolerance,
        0.0,
        (trajectory.joint_names[joint],),
    )
