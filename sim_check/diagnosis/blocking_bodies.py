"""Why no motion was found: which bodies are in the way, by planning in twins without them.

Movable things that the subtask does not name, and whatever nobody named, lose their contacts
(`sim_check.twin.collision_masks`) and stay where they are. If motions exist without all of them, but not with all of
them, some are in the way: a single one without which a motion exists, else a smallest set.

Where a motion was played in vain though the twin has nothing against it, the twin may be wrong by what perception is
unsure of: a cube seen a finger's breadth nearer to an edge than it stands. So bodies are suspected that keep every
motion from leaving as much room as perception may err by. A joint's own suspects were pushed against before.

Nothing here knows a name or a scene; it is all geometry and simulation.
"""

from dataclasses import dataclass, replace

import numpy as np

from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.robot.kinematics import ArmKinematics
from control.safety.limits import SafetyLimits
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec
from control.tasks.subtasks import read_subtask
from control.twin_model import TwinJoint, TwinModel
from sim_check.diagnosis.joints import JointBlame, blame
from sim_check.twin.collision_masks import without_contacts

EXPLAINABLE = ("no_candidate", "unsafe")
ROLLOUTS = 6  # candidates that are simulated for one thought
SURE = 2.0  # times the spread of a position: what perception errs by in one case of twenty
MOST_ROOM = 0.015  # [m] that a motion is asked to leave beyond the clearances


def diagnose(
    twin: TwinModel,
    spec: RewardSpec,
    failure: FailureCause | None,
    safety: SafetyLimits,
    rng: np.random.Generator,
    kinematics: ArmKinematics | None = None,
    nthread: int = 2,
) -> FailureCause:
    """Turn "no motion was found" into "these bodies are in the way", where they are.

    Args:
        twin: Where the search failed.
        spec: What it should have achieved.
        failure: What the search said; None searches first (a motion was played and did not achieve it).
        safety: The safety table.
        rng: Source of randomness.
        kinematics: The arm; read from its URDF when left out.
        nthread: Threads for simulation; the answer does not depend on it.

    Returns:
        `blocked_by` with the bodies and what would be possible without each; `locked` for a joint that is free in the
        twin though it did not move; or the failure as it was, with what was
        found out in its evidence, when nothing movable explains it.
    """
    arm = kinematics or ArmKinematics.from_urdf(gripper=twin.gripper)
    thought = _Thought(twin, spec, safety, int(rng.integers(2**32)), arm, nthread)
    task = read_subtask(spec)
    joint = twin.joint(str(task.subject)) if task.manipulation == "drive" else None
    pushed = None if joint is None else blame(twin, joint, task.amount)
    if joint is not None and pushed is not None and pushed.bodies:
        return _joint_blocked(joint.name, pushed, failure)
    if failure is None:
        found = thought.plan(())
        if isinstance(found, MotionPlan):
            return _uncaused(thought, joint, pushed)
        failure = found
    if failure.kind not in EXPLAINABLE or "counts" not in failure.evidence:
        return failure
    bodies, alone = thought.in_the_way(failure)
    if not bodies:
        return replace(failure, evidence={**failure.evidence, "explained_by_bodies": False})
    subject, named = failure.subject, _named(bodies)
    verb = "is" if len(bodies) == 1 else "are"
    return FailureCause(
        "blocked_by",
        subject,
        f"{named} {verb} in the way of '{subject}': with {named} gone there is a motion, as things stand there is none",
        bodies=bodies,
        evidence={
            **failure.evidence,
            "without": {" and ".join(k): v for k, v in thought.answers.items()},
            "any_of": alone,
            "search_said": failure.message,
        },
    )


def _uncaused(thought: "_Thought", joint: TwinJoint | None, pushed: JointBlame | None) -> FailureCause:
    """Why a motion that the twin has nothing against was played in vain: what perception may err by, or the unseen."""
    subject = thought.spec.primary.subject
    if joint is not None:
        message = (
            f"nothing that was seen holds '{subject}': in the twin it is free and a motion drives it; something unseen "
            "locks it"
        )
        return FailureCause("locked", subject, message, evidence=_push_evidence(pushed))
    room, bodies = _close_call(thought)
    if bodies:
        named = _named(bodies)
        verb = "is" if len(bodies) == 1 else "are"
        message = (
            f"{named} {verb} likely in the way of '{subject}': the motion that was found leaves less than "
            f"{room * 1e3:.0f} mm more room than it must, which is what perception may err by; with {named} gone there "
            "is one that leaves more"
        )
        return FailureCause("blocked_by", subject, message, bodies=bodies, evidence={"room": room})
    return FailureCause(
        "not_achieved",
        subject,
        "a motion exists in the twin, so nothing that it knows of explains the failure; look again",
        evidence={"room": room},
    )


def _close_call(thought: "_Thought") -> tuple[float, tuple[str, ...]]:
    """Room in [m] that a motion should leave beyond the clearances, and the bodies that keep every motion from it."""
    spreads = [float(np.max(o.position_std[:2])) for o in thought.twin.objects if o.movable]
    room = min(MOST_ROOM, SURE * max(spreads, default=0.0))
    s = thought.safety
    wary = replace(
        thought,
        safety=replace(
            s,
            arm_clearance=s.arm_clearance + room,
            held_clearance=s.held_clearance + room,
            # A grasp is checked by its feel; what is asked of fingers also narrows what they can open around.
            finger_clearance=s.finger_clearance + room / 4,
        ),
    )
    found = wary.plan(())
    if isinstance(found, MotionPlan) or found.kind not in EXPLAINABLE:
        return room, ()
    return room, wary.in_the_way(found)[0]


def _named(bodies: tuple[str, ...]) -> str:
    return " and ".join(f"'{b}'" for b in bodies)


def _joint_blocked(joint: str, pushed: JointBlame, failure: FailureCause | None) -> FailureCause:
    named = _named(pushed.bodies)
    verb = "keeps" if len(pushed.bodies) == 1 else "keep"
    said = {} if failure is None else {**failure.evidence, "search_said": failure.message}
    return FailureCause(
        "blocked_by",
        joint,
        f"{named} {verb} '{joint}' from moving: pushed, it gets {pushed.push.progress:.0%} of the way, and all of it "
        f"with {named} gone",
        bodies=pushed.bodies,
        evidence={**said, **_push_evidence(pushed)},
    )


def _push_evidence(pushed: JointBlame | None) -> dict[str, object]:
    """Shares of the way and forces behind a joint's blame."""
    if pushed is None:
        return {}
    return {
        "progress": pushed.push.progress,
        "progress_without": pushed.without,
        "resisted": pushed.push.resisted,
        "pushed_aside": pushed.push.aside,
    }


@dataclass
class _Thought:
    """Searches in twins without some bodies; every one starts from the same seed."""

    twin: TwinModel
    spec: RewardSpec
    safety: SafetyLimits
    seed: int
    arm: ArmKinematics
    nthread: int

    def __post_init__(self) -> None:
        self.answers: dict[tuple[str, ...], bool] = {}

    def plan(self, gone: tuple[str, ...]) -> MotionPlan | FailureCause:
        return plan_motion(
            without_contacts(self.twin, gone),
            self.spec,
            self.safety,
            np.random.default_rng(self.seed),
            kinematics=self.arm,
            max_rollouts=ROLLOUTS,
            nthread=self.nthread,
        )

    def possible(self, gone: list[str]) -> bool:
        key = tuple(sorted(gone))
        if key not in self.answers:
            self.answers[key] = isinstance(self.plan(key), MotionPlan)
        return self.answers[key]

    def in_the_way(self, failure: FailureCause) -> tuple[tuple[str, ...], list[str]]:
        """Bodies without which there is a motion, none when there never is; and all that suffice alone."""
        near = failure.evidence.get("too_close_to", {})
        twin, spec = self.twin, self.spec
        loose = [o.name for o in twin.objects if o.movable or not o.named]
        suspects = [name for name in loose if name not in spec.names and name != twin.held]
        suspects.sort(key=lambda name: -near.get(name, 0))
        if not suspects or not self.possible(suspects):
            return (), []
        alone = [name for name in suspects if self.possible([name])]
        return tuple(alone[:1] or self._smallest(suspects)), alone

    def _smallest(self, suspects: list[str]) -> list[str]:
        """Bodies none of which can be left in place: suspects are put back one at a time, unlikely ones first."""
        gone = list(suspects)
        for name in reversed(suspects):
            fewer = [g for g in gone if g != name]
            if fewer and self.possible(fewer):
                gone = fewer
        return gone
