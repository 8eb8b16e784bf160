"""Why a search has nothing to offer: what rules it out beforehand, and at which stage its candidates were lost."""

import numpy as np

from control.grasping.grasps import graspable_width
from control.path_planning.planning_context import PlanningContext
from control.planners.result import MotionStats
from control.safety.limits import SafetyLimits
from control.tasks.failure import FailureCause
from control.tasks.motion_cost import Score
from control.tasks.reward_spec import PALM, RewardSpec
from control.tasks.subtasks import Subtask, posed_objects, unseen
from control.twin_model import TwinModel

SHUT = 0.15  # fraction below which a door lets nothing through


def hindrance(twin: TwinModel, spec: RewardSpec, task: Subtask, safety: SafetyLimits) -> FailureCause | None:
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
        if thing.doubts:
            return FailureCause("not_seen", subject, f"'{subject}' is not taken hold of: {'; '.join(thing.doubts)}")
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


def closed(twin: TwinModel, task: Subtask) -> FailureCause | None:
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


def lost(context: PlanningContext, scores: list[Score], stats: MotionStats) -> FailureCause:
    """Say at which stage the last candidates were lost.

    Args:
        context: With its counts.
        scores: Of all candidates that were simulated, best first.
        stats: What the search spent.
    """
    task, counts = context.subtask, stats.counts
    subject = task.subject or (str(task.target) if task.target in context.objects else PALM)
    evidence = {
        "counts": counts,
        "steps": stats.steps,
        "seconds": stats.seconds,
        "too_close_to": dict(context.filter.rejected_by.most_common(6)),
    }
    if scores and scores[0].success:
        broken = [c for c in scores[0].checks if not c.ok]
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
    if scores:
        return FailureCause(
            "no_candidate",
            subject,
            f"none of {len(scores)} simulated motions reaches the goal; the best ends with: {_short_of(scores[0])}",
            evidence=evidence,
        )
    if context.driven_to is not None:
        evidence["driven_to"] = context.driven_to
    return FailureCause("no_candidate", subject, _lost_at(context, subject), evidence=evidence)


def _short_of(score: Score) -> str:
    return "; ".join(j.text for j in (score.judgement, *score.unmet) if not j.met)


def _lost_at(context: PlanningContext, subject: str) -> str:
    """One sentence about the stage at which no candidate was left."""
    counts, task = context.counts, context.subtask
    blamed = [
        n
        for n, _ in context.filter.rejected_by.most_common()
        if (n in context.objects or context.twin.joint(n)) and n != subject
    ]
    near = ", ".join(f"'{n}'" for n in blamed[:2]) or "other things"
    target = f"'{task.target}'" if task.target else "its place"
    if task.manipulation in ("rest", "retreat") and not counts["ends"]:
        return "no posture that was tried takes the palm as far as the goal asks"
    if counts["grasps"] and not counts["grasps_reachable"]:
        distance = float(np.linalg.norm(context.objects[subject].position[:2])) if subject in context.objects else 0.0
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
        return f"'{subject}' can be taken, but from none of {counts['pairs']} holds raised to {task.amount:.2f} m"
    if context.driven_to is not None:
        return (
            f"{subject} can be driven to {context.driven_to:.0%} at most: no hold of its handle, nor two one after the "
            "other, takes it further; ask for less"
        )
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
