"""Why no motion was found: which bodies are in the way, by taking them away in thought.

Movable things that the subtask does not name are made ghosts: they touch nothing, nothing touches them, and they stay
where they are. If motions exist with all of them gone, but not with all of them there, some are to blame: a single one
without which it works, else a smallest set. Nothing here knows a name or a scene; it is all geometry and simulation.
"""

from dataclasses import dataclass, replace

import numpy as np

from control.failure import FailureCause
from control.kinematics import ArmKinematics
from control.motion_result import MotionPlan
from control.motion_search import plan_motion
from control.rewards import RewardSpec
from control.safety import SafetyLimits
from control.subtasks import read_subtask
from control.twin_model import TwinModel
from sim_check.ghosts import ghosted
from sim_check.joint_diagnosis import JointBlame, blame

EXPLAINABLE = ("no_candidate", "unsafe")
ROLLOUTS = 6  # candidates that are simulated for one thought


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
    pushed = None if joint is None else blame(twin, joint, float(task.term.value or 0.0))
    if joint is not None and pushed is not None and pushed.bodies:
        return _joint_blocked(joint.name, pushed, failure)
    if failure is None:
        found = thought.plan(())
        if isinstance(found, MotionPlan) and joint is not None:
            return FailureCause(
                "locked",
                joint.name,
                f"nothing that was seen holds '{joint.name}': in the twin it is free and a motion drives it; something "
                "unseen locks it",
                evidence=_push_evidence(pushed),
            )
        if isinstance(found, MotionPlan):
            return FailureCause(
                "not_achieved",
                spec.primary.subject,
                "a motion exists in the twin, so nothing that it knows of explains the failure; look again",
            )
        failure = found
    if failure.kind not in EXPLAINABLE or "counts" not in failure.evidence:
        return failure
    near = failure.evidence.get("too_close_to", {})
    suspects = [o.name for o in twin.objects if o.movable and o.name not in spec.names and o.name != twin.held]
    suspects.sort(key=lambda name: -near.get(name, 0))
    if not suspects or not thought.possible(suspects):
        return replace(failure, evidence={**failure.evidence, "explained_by_bodies": False})
    alone = [name for name in suspects if thought.possible([name])]
    bodies = alone[:1] if alone else _smallest(thought, suspects)
    subject = failure.subject
    named = " and ".join(f"'{b}'" for b in bodies)
    verb = "is" if len(bodies) == 1 else "are"
    return FailureCause(
        "blocked_by",
        subject,
        f"{named} {verb} in the way of '{subject}': with {named} gone there is a motion, as things stand there is none",
        bodies=tuple(bodies),
        evidence={
            **failure.evidence,
            "without": {" and ".join(k): v for k, v in thought.answers.items()},
            "any_of": alone,
            "search_said": failure.message,
        },
    )


def _joint_blocked(joint: str, pushed: JointBlame, failure: FailureCause | None) -> FailureCause:
    named = " and ".join(f"'{b}'" for b in pushed.bodies)
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
            ghosted(self.twin, gone),
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


def _smallest(thought: _Thought, suspects: list[str]) -> list[str]:
    """A set of bodies none of which can be left in place: suspects are put back one at a time, unlikely ones first."""
    gone = list(suspects)
    for name in reversed(suspects):
        fewer = [g for g in gone if g != name]
        if fewer and thought.possible(fewer):
            gone = fewer
    return gone
