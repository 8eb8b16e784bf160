"""The verdict on a retimed trajectory: every safety check in the nominal twin, its success rate in perturbed ones.

The nominal twin is judged by everything: the samples themselves (`control.safety.trajectory_checks`), the safety
residuals of the replayed motion, clearances, and the reward. A perturbed twin counts as a success when the reward
is met and no residual of the replay is broken; clearances are left out there, as what moved by its own
uncertainty is nearer on one side by right. A motion passes when the nominal twin keeps every check and enough of the
perturbed ones succeed. A motion whose purpose is not known is judged by the same residuals, the reward left out.
"""

from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass

import numpy as np

from control.errors import TrajectoryError, UnknownObjectError
from control.robot.dynamics import Payload, RobotModel
from control.robot.limits import REST_Q, RobotLimits
from control.safety.certificate import CheckResult, Verdict
from control.safety.limits import SafetyLimits
from control.safety.residuals import TwinMotion
from control.safety.swept_volume import SweptUnseen
from control.safety.trajectory_checks import check_trajectory
from control.simulation.rollouts import Rollout
from control.tasks.reward_spec import RewardSpec
from control.tasks.subtasks import palm_at
from control.trajectory.samples import Trajectory
from control.twin_model import TwinModel
from sim_check.twin.payloads import held_payloads, loaded_torque
from sim_check.twin.twin import possible_twins
from sim_check.verdict.judged_replay import Replayed, ReplayQuestion, judge_replay

# Least share of perturbed twins that must succeed. A good motion that succeeds nine times in ten gets four of six with
# a probability of 0.98; one that succeeds every other time, with 0.34.
SUCCESS_SHARE = 2 / 3
NORMAL_95 = 1.959964  # quantile of the standard normal distribution for a two-sided 95 % interval


@dataclass(frozen=True)
class Judgement:
    """A verdict with what it rests on.

    Attributes:
        verdict: Whether the motion passes, and every check.
        motion: The nominal twin's motion as recorded, clearances included; None when the simulation exploded.
        rollout: The nominal twin's states, to draw pictures from.
        failures: In how many perturbed twins each check was broken, by its name; checks that held are left out.
        unseen: What of the way no camera has seen, in the nominal twin; None where no camera has looked.
    """

    verdict: Verdict
    motion: TwinMotion | None
    rollout: Rollout
    failures: dict[str, int]
    unseen: SweptUnseen | None = None


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
    """Judge exactly the samples that a robot would play, by a spec; see `judge_in_detail` for the arguments."""
    return judge_in_detail(
        trajectory,
        twin,
        safety,
        limits,
        rng,
        spec=spec,
        perturbed=perturbed,
        nthread=nthread,
        robot=robot,
        success_share=success_share,
    ).verdict


def judge_in_detail(
    trajectory: Trajectory,
    twin: TwinModel,
    safety: SafetyLimits,
    limits: RobotLimits,
    rng: np.random.Generator,
    *,
    spec: RewardSpec | None = None,
    handled: frozenset[str] = frozenset(),
    perturbed: int = 6,
    nthread: int = 2,
    robot: RobotModel | None = None,
    success_share: float = SUCCESS_SHARE,
    payload: Payload | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> Judgement:
    """Judge exactly the samples that a robot would play, ours or anybody's.

    What is in the hand follows from `trajectory.segments[*].held`. Where segments also say what may touch, a held
    object keeps its distance from everything else in between; where they do not, it may always touch what carried it
    at the start, the table and other handled things.

    Args:
        trajectory: Retimed, 1 kHz.
        twin: What is believed to stand around.
        safety: The safety table.
        limits: Published limits of the robot.
        rng: Source of randomness for the perturbed twins.
        spec: What the motion should achieve; None judges every residual and no reward.
        handled: Objects and joints that may be touched, held and moved, beside those of the spec; nothing else may be.
            Where one of them is put down on another thing, that thing has to be among them.
        perturbed: Number of perturbed twins; 0 judges by the nominal twin alone.
        nthread: Threads for simulation; the verdict does not depend on it.
        robot: Rigid-body model for torques and the hand's speed; the Panda with the twin's gripper, open, by default.
        success_share: Least share of perturbed twins that must succeed.
        payload: What the hand carries all the time and the twin does not know of: a tool, or an object that was not
            perceived. What the twin has in it counts by itself while segments hold it.
        on_progress: Told how many twins of how many were judged, after each.

    Raises:
        UnknownObjectError: `handled` names something that the twin does not have.
        TrajectoryError: A segment holds something that the twin does not have or that cannot be moved.
    """
    _require_known(trajectory, twin, handled)
    robot = robot or RobotModel.panda(gripper=twin.gripper)
    carrying = robot if payload is None else robot.with_payload(payload)
    question = ReplayQuestion(trajectory, spec, handled, safety, palm_at(twin, REST_Q))
    twins = [twin, *possible_twins(twin, rng, perturbed, nthread)]
    replayed: dict[int, Replayed] = {}
    with ThreadPoolExecutor(max(1, nthread)) as pool:
        jobs = {pool.submit(judge_replay, question, t, nominal=i == 0): i for i, t in enumerate(twins)}
        # The samples are checked while twins are simulated.
        torque = loaded_torque(carrying, trajectory, held_payloads(twin))
        of_samples = check_trajectory(trajectory, limits, safety, torque, robot.tcp_poses)
        for job in as_completed(jobs):
            replayed[jobs[job]] = job.result()
            if on_progress is not None:
                on_progress(len(replayed), len(twins))
    checks = (
        *of_samples,
        _start_state(trajectory, twin, safety),
        *replayed[0].checks,
    )
    trials = [replayed[i] for i in range(1, len(twins))]
    successes = sum(trial.kept for trial in trials)
    # Twins that could not be drawn count against the motion: what cannot be imagined otherwise is not known to be safe.
    enough = successes >= success_share * perturbed - 1e-9
    verdict = Verdict(
        checks=checks,
        successes=successes,
        trials=len(trials),
        interval=wilson_interval(successes, len(trials)),
        passed=all(c.ok for c in checks) and enough,
        steps=sum(r.steps for r in replayed.values()),
    )
    failures = Counter(c.name for trial in trials for c in trial.checks if not c.ok)
    assert replayed[0].rollout is not None  # the nominal twin's is kept
    return Judgement(verdict, replayed[0].motion, replayed[0].rollout, dict(failures.most_common()), replayed[0].unseen)


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


def _require_known(trajectory: Trajectory, twin: TwinModel, handled: frozenset[str]) -> None:
    """Names that the twin does not have would silently allow or forbid the wrong things."""
    movable = sorted(held_payloads(twin))
    known = sorted({o.name for o in twin.objects} | {j.name for j in twin.joints})
    for name in sorted(handled - set(known)):
        raise UnknownObjectError(f"no object or joint named '{name}' to be handled in this twin; it has {known}")
    for segment in trajectory.segments:
        if segment.held is not None and segment.held not in movable:
            raise TrajectoryError(
                f"segment '{segment.name}' holds '{segment.held}', which is nothing that can be held in this twin; "
                f"it has {movable}: name the object as the twin does, or judge the motion with a payload instead"
            )
