"""What a run has learnt about its cell, as sentences for prompts: what is locked, was in the way or is empty."""

from collections.abc import Mapping

from control.tasks.failure import FailureCause
from perception.estimates import SceneEstimate
from planning.language.furnishings import KnownFurniture
from planning.loop.perceiver import CLOSED, SEEN_INTO


class CellMemory:
    """Keeps what failures and looks have taught.

    Args:
        furniture: What is known of furniture, by name.
    """

    def __init__(self, furniture: Mapping[str, KnownFurniture]) -> None:
        self._furniture = furniture
        self._locked: set[str] = set()
        self._in_the_way: dict[tuple[str, str], None] = {}
        self._not_in: dict[tuple[str, str], None] = {}

    def note_failure(self, cause: FailureCause) -> None:
        """Learn from why a step failed."""
        if cause.kind == "locked":
            self._locked.add(cause.subject)
        if cause.kind == "blocked_by":
            self._in_the_way.update(dict.fromkeys((body, cause.subject) for body in cause.bodies))

    def note_look(self, scene: SceneEstimate) -> None:
        """Learn from what is seen: a joint that has moved is not locked, and an open inside shows what is not in it."""
        shares = {name: share for o in scene.objects for name, share in o.joint_fractions.items()}
        self._locked -= {joint for joint in self._locked if shares.get(joint, 0.0) > CLOSED}
        for thing in self._furniture.values():
            doors = [j.name for j in thing.joints] if thing.has_inside else []
            if doors and all(shares.get(door, 0.0) >= SEEN_INTO for door in doors):
                self._not_in.update(dict.fromkeys((u.name, thing.name) for u in scene.unseen))
        self._not_in = {k: None for k in self._not_in if scene.get(k[0]) is None}

    def lines(self) -> tuple[str, ...]:
        """Everything learnt, one sentence each."""
        return (
            *(f"{joint} is locked" for joint in sorted(self._locked)),
            *(f"{body} was in the way of {subject}" for body, subject in self._in_the_way),
            *(f"{name} is not in {place}" for name, place in self._not_in),
        )
