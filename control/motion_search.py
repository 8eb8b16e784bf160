"""Finding a motion for one subtask: geometric candidates, full-horizon rollouts in the twin, refinement, choice.

Candidates are simulated a few at a time, and no more once enough of them succeeded cleanly: simulated steps are what a
search costs. Only when no candidate is clean are the best ones varied and tried again. The choice is lexicographic:
success, then clean, then cost.
"""

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from control.batches import Observer
from control.candidates import Candidate, candidates
from control.collision_filter import Phase
from control.contradictions import refuse_contradictions
from control.early_refusals import start_contact, too_high
from control.failure import FailureCause
from control.goal_predicates import judge_term
from control.grasps import graspable_width
from control.kinematics import ArmKinematics
from control.limits import REST_Q, panda_limits
from control.motion_result import MotionPlan, MotionStats
from control.refinement import vary
from control.residuals import safety_residuals
from control.rewards import PALM, RewardSpec
from control.rewards_cost import Score, score_motion
from control.rollouts import Rollout, commands_for, record_motion, roll_out
from control.safety import SafetyLimits
from control.subtasks import Subtask, posed_objects, read_subtask, unseen
from control.trajectory import JointPath, PathSegment
from control.twin_model import TwinModel
from control.workbench import Workbench, path_length

ENOUGH = 2  # clean successes after which no further candidate is simulated
FIRST = 2  # candidates that are simulated together
STRIDE = 3  # every third state of a rollout (12 ms) is looked at for contacts
ROUNDS = 2  # of refinement, only where nothing was clean
VARIED = 8  # variants per round
ELITE = 4
SHUT = 0.15  # fraction below which a door lets nothing through
# Residuals that only a retimed motion can be held against.
RETIMED_ONLY = ("tracked_hand_speed", "tracked_hand_angular_speed")
# A rollout rests only briefly at its end; the verdict waits out the whole settling time.
SETTLE_IN_SEARCH = 0.1  # [s]


@dataclass(frozen=True)
class Tried:
    """A candidate that was simulated."""

    candidate: Candidate
    score: Score


def plan_motion(
    twin: TwinModel,
    spec: RewardSpec,
    safety: SafetyLimits,
    rng: np.random.Generator,
    kinematics: ArmKinematics | None = None,
    max_rollouts: int = 24,
    nthread: int = 2,
    variants: Sequence[TwinModel] = (),
    observe: Observer | None = None,
) -> MotionPlan | FailureCause:
    """Find a motion that meets a spec's primary term in the twin and keeps every safety residual.

    Args:
        twin: What is believed to stand around.
        spec: What to achieve.
        safety: The safety table.
        rng: Source of randomness; the same state gives the same plan at any number of threads.
        kinematics: The arm; read from its URDF when left out.
        max_rollouts: Most candidates to simulate.
        nthread: Threads for simulation.
        variants: Perturbed twins of the same layout. Where given, the best few plans are tried in them as well and the
            one that succeeds most often is chosen.
        observe: Told of each batch of motions that is simulated.

    Returns:
        The plan; or why there is none: `not_seen`, `no_candidate` (with counts of where candidates were lost) or
        `unsafe` (motions reach the goal, but break a check).

    Raises:
        RewardSpecError: A term is of a kind that is not supported yet, or two terms exclude each other.
    """
    began = time.perf_counter()
    task = read_subtask(spec)
    refuse_contradictions(spec, twin)
    arm = kinematics or ArmKinematics.from_urdf(gripper=twin.gripper)
    hindrance = _hindrance(twin, spec, task, safety) or _closed(twin, task) or too_high(twin, task, arm)
    if hindrance is not None:
        return hindrance
    limits = panda_limits()
    bench = Workbench(twin, task, safety, limits, arm, rng)
    search = _Search(bench, spec, nthread, observe)
    palm = bench.filter.tcp_pose(bench.start_q)[:3, 3]
    judged = judge_term(
        spec.primary, bench.objects, palm, bench.rest_palm, None, twin.support_height, twin.joint_fractions()
    )
    if judged.met and twin.held is None and not task.holds:
        return _already_done(bench, task, judged.text, began)
    search.try_all(candidates(bench), max_rollouts)
    if search.tried and not any(t.score.success and t.score.clean for t in search.tried):
        search.refine(max_rollouts)
    good = [t for t in search.ranked() if t.score.success and t.score.clean]
    if good and variants:
        good = search.most_robust(good, variants)
    stats = MotionStats(search.steps, time.perf_counter() - began, _counts(bench, search))
    if not good:
        return start_contact(twin) or _failure(bench, search, stats)
    best = good[0]
    return MotionPlan(
        path=JointPath(best.candidate.segments),
        description=best.candidate.description,
        cost=best.score.cost,
        stats=stats,
        alternatives=tuple(JointPath(t.candidate.segments) for t in good[1:]),
    )


class _Search:
    """The simulated candidates of one search."""

    def __init__(self, bench: Workbench, spec: RewardSpec, nthread: int, observe: Observer | None) -> None:
        self.bench, self.spec, self.nthread, self.observe = bench, spec, nthread, observe
        self.tried: list[Tried] = []
        self.steps = 0
        table = safety_residuals(replace(bench.safety, settle_time=SETTLE_IN_SEARCH))
        self._residuals = tuple(r for r in table if r.name not in RETIMED_ONLY)

    def try_all(self, offered: Iterable[Candidate], most: int) -> None:
        """Simulate candidates a few at a time until enough of them are clean or none is left."""
        source = iter(offered)
        while len(self.tried) < most and self._clean() < ENOUGH:
            group = list(islice(source, min(FIRST, most - len(self.tried))))
            if not group:
                return
            self.tried += self._simulate(group)

    def refine(self, most: int) -> None:
        """Vary the best candidates, until something is clean."""
        for _ in range(ROUNDS):
            elite = [t.candidate for t in self.ranked()[:ELITE]]
            fresh = vary(self.bench, elite, min(VARIED, most))
            self.bench.counts["varied"] += len(fresh)
            if fresh:
                self.tried += self._simulate(fresh)
            if self._clean():
                return

    def ranked(self) -> list[Tried]:
        """Best first."""
        return sorted(self.tried, key=lambda t: t.score.rank)

    def most_robust(self, good: list[Tried], variants: Sequence[TwinModel]) -> list[Tried]:
        """The best few, those first that succeed in most of the perturbed twins."""
        few = good[:ELITE]
        wins = []
        for tried in few:
            commands = [commands_for(tried.candidate.segments, v, self.bench.limits) for v in variants]
            rollouts, steps = roll_out(variants, commands, self.nthread, observe=self.observe)
            self.steps += steps
            scores = [self._score(r, v, tried.candidate) for r, v in zip(rollouts, variants, strict=True)]
            wins.append(sum(s.success + s.clean for s in scores))
        order = sorted(range(len(few)), key=lambda i: (-wins[i], few[i].score.rank))
        return [few[i] for i in order] + good[ELITE:]

    def _simulate(self, group: list[Candidate]) -> list[Tried]:
        bench = self.bench
        commands = [commands_for(c.segments, bench.twin, bench.limits) for c in group]
        rollouts, steps = roll_out([bench.twin] * len(group), commands, self.nthread, observe=self.observe)
        self.steps += steps
        return [Tried(c, self._score(r, bench.twin, c)) for c, r in zip(group, rollouts, strict=True)]

    def _score(self, rollout: Rollout, twin: TwinModel, candidate: Candidate) -> Score:
        supports = frozenset(self.bench.supports)
        motion = record_motion(rollout, twin, self.spec, self.bench.subtask, supports, STRIDE)
        return score_motion(motion, twin, self.spec, self._residuals, self.bench.rest_palm, candidate.preference)

    def _clean(self) -> int:
        return sum(t.score.success and t.score.clean for t in self.tried)


def _hindrance(twin: TwinModel, spec: RewardSpec, task: Subtask, safety: SafetyLimits) -> FailureCause | None:
    """What rules out a motion before any search."""
    missing = unseen(twin, spec)
    if missing is not None:
        return missing
    subject = task.subject or task.target or "palm"
    if task.subject is None:
        return None
    if twin.held is not None and twin.held != task.subject:
        return FailureCause(
            "no_candidate",
            subject,
            f"the hand holds '{twin.held}'; put it down before '{task.subject}' can be handled",
            evidence={"held": twin.held},
        )
    thing = twin.get(task.subject)
    if twin.held is None and thing is not None:
        if not thing.movable:
            return FailureCause("no_candidate", subject, f"'{subject}' is fixed and cannot be carried")
        width = graspable_width(posed_objects(twin, twin.start())[task.subject])
        if thing.handle is not None:
            width = min(width, 2 * thing.handle.half_width)
        widest = twin.gripper.widest(safety.finger_clearance)
        if width > widest:
            return FailureCause(
                "no_candidate",
                subject,
                f"'{subject}' is too wide for the gripper: its smallest width is {width * 1e3:.0f} mm, the fingers "
                f"take {widest * 1e3:.0f} mm",
                evidence={"width": width, "widest": widest},
            )
    return None


def _closed(twin: TwinModel, task: Subtask) -> FailureCause | None:
    """Whether what the subject should go into is shut."""
    inside = next((c for c in twin.compartments if c.owner == task.target), None)
    if task.manipulation != "place" or inside is None or not inside.joints:
        return None
    opened = twin.joint_fractions()
    if max(opened.get(name, 1.0) for name in inside.joints) >= SHUT:
        return None
    named = " or ".join(f"'{name}'" for name in inside.joints)
    return FailureCause(
        "blocked_by",
        str(task.subject),
        f"'{task.target}' is closed: open {named} before '{task.subject}' can go in",
        bodies=inside.joints,
        evidence={"fractions": {name: opened[name] for name in inside.joints if name in opened}},
    )


def _already_done(bench: Workbench, task: Subtask, text: str, began: float) -> MotionPlan | FailureCause:
    """Nothing to do but to come to rest (or to stay, where the palm itself is the point)."""
    stays = task.manipulation in ("reach", "retreat")
    end = bench.start_q if stays else np.array(REST_Q)
    path = bench.way(bench.start_q, end, Phase.FREE, bench.twin.gripper_width, None, planner=True)
    stats = MotionStats(0, time.perf_counter() - began, dict(bench.counts))
    if path is None:
        return FailureCause("no_candidate", task.subject or "palm", "no free way back to the rest position")
    name = "reach" if stays else "home"
    return MotionPlan(JointPath((PathSegment(name, path),)), f"met already: {text}", path_length(path), stats)


def _counts(bench: Workbench, search: _Search) -> dict[str, int]:
    return {
        **bench.counts,
        "configurations_checked": bench.filter.checks,
        "rollouts": len(search.tried),
        "successes": sum(t.score.success for t in search.tried),
        "clean": sum(t.score.success and t.score.clean for t in search.tried),
    }


def _failure(bench: Workbench, search: _Search, stats: MotionStats) -> FailureCause:
    """Say at which stage the last candidates were lost."""
    task, counts = bench.subtask, stats.counts
    subject = task.subject or (str(task.target) if task.target in bench.objects else PALM)
    evidence = {
        "counts": counts,
        "steps": stats.steps,
        "seconds": stats.seconds,
        "too_close_to": dict(bench.filter.rejected_by.most_common(6)),
    }
    reached = [t for t in search.ranked() if t.score.success]
    if reached:
        broken = [c for c in reached[0].score.checks if not c.ok]
        check = max(broken, key=lambda c: c.worst / max(c.limit, 1e-3))
        evidence |= {"worst": check.worst, "limit": check.limit, "unit": check.unit, "bodies": check.bodies}
        return FailureCause(
            "unsafe",
            subject,
            f"every motion found breaks '{check.name}': {check.worst:.3g} {check.unit} where {check.limit:.3g} is "
            f"allowed ({' and '.join(check.bodies)})",
            check=check.name,
            evidence=evidence,
        )
    if search.tried:
        best = search.ranked()[0].score.judgement
        return FailureCause(
            "no_candidate",
            subject,
            f"none of {len(search.tried)} simulated motions reaches the goal; the best ends with: {best.text}",
            evidence=evidence,
        )
    return FailureCause("no_candidate", subject, _lost_at(bench, subject), evidence=evidence)


def _lost_at(bench: Workbench, subject: str) -> str:
    """One sentence about the stage at which no candidate was left."""
    counts, task = bench.counts, bench.subtask
    blamed = [
        n
        for n, _ in bench.filter.rejected_by.most_common()
        if (n in bench.objects or bench.twin.joint(n)) and n != subject
    ]
    near = ", ".join(f"'{n}'" for n in blamed[:2]) or "other things"
    target = f"'{task.target}'" if task.target else "its place"
    if task.manipulation in ("rest", "retreat") and not counts["ends"]:
        return "no posture that was tried takes the palm as far as the goal asks"
    if counts["grasps"] and not counts["grasps_reachable"]:
        distance = float(np.linalg.norm(bench.objects[subject].position[:2])) if subject in bench.objects else 0.0
        return (
            f"'{subject}' is out of reach: it is {distance:.2f} m away from the base, and the arm reaches none of "
            f"{counts['grasps']} ways to take it"
        )
    out_of_way = task.manipulation == "drive" and not counts["drives_rough"]
    if counts["grasps_reachable"] and not counts["grasps_free"] and not out_of_way:
        return (
            f"'{subject}' cannot be taken: all {counts['grasps_reachable']} reachable grasps come too close to {near}"
        )
    if task.manipulation == "lift" and counts["pairs"]:
        return f"'{subject}' can be taken, but from none of {counts['pairs']} holds raised to {task.term.value:.2f} m"
    if task.manipulation == "drive":
        if not counts["drives_free"]:
            return (
                f"'{subject}' cannot be driven as far as asked: none of {counts['drives_tried']} ways to take its "
                f"handle along is free, near {near}"
            )
        return f"no free way to or from the handle of '{subject}', near {near}"
    if task.releases and not counts["places"]:
        return f"there is no free place for '{subject}' that meets the goal"
    if task.releases and not counts["places_reachable"]:
        return f"{target} is out of reach: the arm reaches none of {counts['places']} places for '{subject}'"
    if task.releases and not counts["places_free"]:
        return (
            f"'{subject}' cannot be put there: all {counts['places_reachable']} combinations of hand and place that "
            f"the arm reaches come too close to {near}"
        )
    if counts["transits_blocked"]:
        return f"no free way for '{subject}': {counts['pairs']} combinations of grasp and place were tried, near {near}"
    return f"no motion was found for '{subject}'"
