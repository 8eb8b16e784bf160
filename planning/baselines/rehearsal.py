"""Hands that can say what a motion would lead to before anything moves."""

from dataclasses import dataclass
from typing import Any, Protocol

from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec
from perception.estimates import SceneEstimate
from planning.loop.interfaces import AttemptResult, MotionExecutor


@dataclass(frozen=True)
class Rehearsal:
    """A motion that was found and judged, and not played.

    Attributes:
        scene: What would be seen after it, as far as can be told: things where the motion puts them, joints where it
            drives them, all else where it was seen.
        motion: For the motion executor alone.
    """

    scene: SceneEstimate
    motion: Any


class RehearsingExecutor(MotionExecutor, Protocol):
    """A motion executor that can rehearse."""

    def rehearse(
        self, spec: RewardSpec, scene: SceneEstimate, after: Rehearsal | None = None
    ) -> Rehearsal | FailureCause:
        """Find and judge a motion as `attempt` does, and play nothing.

        Args:
            spec: What to achieve.
            scene: What was seen, or what a rehearsal says will be.
            after: The rehearsal that this one follows: the arm starts where that one ends. None starts where the
                robot is.
        """
        ...

    def play(self, rehearsal: Rehearsal) -> AttemptResult:
        """Play exactly the motion that was rehearsed.

        Raises:
            RefusedError: The driver refused the motion.
            RobotGoneError, StoppedError: The run cannot go on.
        """
        ...
