"""What a run looks for: the names of its cell, and whatever else its goal speaks of."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from perception.errors import UnknownPhraseError
from perception.estimates import SceneEstimate, Unseen
from planning.language.furnishings import KnownFurniture
from planning.language.goal_language import mentioned_phrases, only_compared_with
from planning.language.names import ANYTHING, SUPPORTS, all_said_of, as_name, candidates, words_of
from planning.loop.interfaces import SceneObserver
from planning.reasoners.reasoner import Log


class VisualTargets:
    """Looks for the right names, and knows what of the goal is missing.

    Args:
        goal: In plain language.
        known: The cell's names.
        observer: Looks.
        log: Gets `goal`, and `unlookable` for a name that the detector has no way to look for.
        furniture: What is known of furniture; words that mean one of its joints mean the furniture.

    Attributes:
        names: All that is looked for.
        wanted: Names that the goal may mean.
    """

    def __init__(
        self,
        goal: str,
        known: Sequence[str],
        observer: SceneObserver,
        log: Log,
        furniture: Mapping[str, KnownFurniture] | None = None,
    ) -> None:
        self._observer = observer
        self._log = log
        known = tuple(dict.fromkeys((*known, *(furniture or {}))))
        self._known = frozenset(known)
        joints = {j.name: j.owner for thing in (furniture or {}).values() for j in thing.joints}
        self._unlookable: dict[str, str] = {}
        # "the red thing" is no name to look for, and what everything stands on is always there.
        phrases = [p for p in mentioned_phrases(goal) if as_name(p) and words_of(p)[-1] not in ANYTHING | SUPPORTS]
        self._meanings = {
            as_name(p): tuple(candidates(p, known)) or _owners(p, joints) or (as_name(p),) for p in phrases
        }
        self._models = {as_name(p) for p in only_compared_with(goal)}
        self.wanted = tuple(dict.fromkeys(n for means in self._meanings.values() for n in means))
        self.names = tuple(dict.fromkeys((*known, *self.wanted)))
        log("goal", goal=goal, names=self.names, wanted=self.wanted)

    def look(self) -> SceneEstimate:
        """A fresh look; names that the detector cannot look for count as not seen.

        Raises:
            PerceptionError: Nothing can be seen.
        """
        names = [n for n in self.names if n not in self._unlookable]
        try:
            scene = self._observer.look(names)
        except UnknownPhraseError as error:
            if not names:
                raise
            # The error does not say which name it is. What only the goal speaks of is suspected first.
            self._find_unlookable([n for n in names if n not in self._known] or names, error)
            return self.look()
        unlookable = tuple(Unseen(n, r) for n, r in self._unlookable.items())
        return replace(scene, unseen=(*scene.unseen, *unlookable)) if unlookable else scene

    def _find_unlookable(self, suspects: Sequence[str], error: UnknownPhraseError) -> None:
        found = {}
        for name in suspects if len(suspects) > 1 else ():
            try:
                self._observer.look([name])
            except UnknownPhraseError as alone:
                found[name] = str(alone)
        for name, reason in (found or dict.fromkeys(suspects, str(error))).items():
            self._unlookable[name] = reason
            self._log("unlookable", name=name, reason=reason)

    def missing(self, scene: SceneEstimate) -> tuple[str, ...]:
        """What the goal speaks of and nothing in view can be; as names."""
        seen = set(scene.names)
        return tuple(n for n, means in self._meanings.items() if not set(means) & seen and n not in self._models)

    def missing_sentence(self, scene: SceneEstimate) -> str:
        """What is missing and what is there, for people."""
        missing = [n.replace("_", " ") for n in self.missing(scene)]
        seen = ", ".join(n.replace("_", " ") for n in scene.names) or "nothing"
        return f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} not in view; in view: {seen}"


def _owners(phrase: str, joints: Mapping[str, str]) -> tuple[str, ...]:
    """Furniture with a joint that words like "the left door" may mean."""
    return tuple(dict.fromkeys(owner for joint, owner in joints.items() if all_said_of(phrase, joint)))
