"""What a run remembers of its attempts, and typed failure causes in words. Needs the standard library only."""

from collections.abc import Collection
from dataclasses import dataclass

from control.tasks.failure import FailureCause

# Causes that lie in the motion itself and say nothing against the plan.
MOTION_FAILED = "The motion itself failed"
NOBODY_KNOWS = "It failed."  # all that is said where nobody perceives
_OF_THE_MOTION = ("lost_grasp", "tracking_error", "refused_by_robot", "reasoner_error")


@dataclass(frozen=True)
class FailedAttempt:
    """One failed attempt at a step.

    Attributes:
        executing: The steps of the plan that was carried out.
        action: The step that failed.
        reason: Why, as far as is known, in sentences about objects.
        after: Steps that had been finished before.
    """

    executing: tuple[str, ...]
    action: str
    reason: str
    after: tuple[str, ...] = ()


@dataclass(frozen=True)
class FailedPlan:
    """A plan that did not reach the goal.

    Attributes:
        thought: Of its author.
        steps: Its actions.
        why: Why it failed.
    """

    thought: str
    steps: tuple[str, ...]
    why: str


def cause_sentences(cause: FailureCause, objects: Collection[str]) -> tuple[str, ...]:
    """A typed cause in sentences of fixed form, then its own message.

    Args:
        cause: From an attempt.
        objects: Names of the scene; other bodies (links of the robot, the table) are left to the message.
    """
    bodies = [b for b in dict.fromkeys(cause.bodies) if b in objects and b != cause.subject]
    if cause.kind == "blocked_by":
        typed = [f"{b} is in the way of {cause.subject}." for b in bodies]
    elif cause.kind == "unsafe":
        typed = [f"No safe motion was found for {cause.subject}{f' ({cause.check})' if cause.check else ''}."]
        typed += [f"{b} is too close." for b in bodies]
    elif cause.kind in _OF_THE_MOTION:
        typed = [f"{MOTION_FAILED} ({cause.kind.replace('_', ' ')})."]
    else:
        typed = {
            "no_candidate": [f"No motion was found for {cause.subject}."],
            "locked": [f"{cause.subject} is locked."],
            "not_seen": [f"{cause.subject} is not in view."],
            "not_achieved": [f"The motion was played, but its result for {cause.subject} is not seen."],
        }.get(cause.kind, [])
    message = " ".join(cause.message.split())
    return (*typed, *([message if message.endswith(".") else message + "."] if message else []))
