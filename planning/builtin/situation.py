"""What the rule-based planner knows when it plans, and which things and joints words mean in it."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from control.errors import GoalError
from perception.catalogue.catalogue import builtin_catalogue
from planning.language.goal_language import Clause
from planning.language.memory import MOTION_FAILED, FailedAttempt
from planning.language.names import (
    ANYTHING,
    LIKE,
    SUPPORTS,
    AmbiguousName,
    MissingName,
    all_said_of,
    as_name,
    candidates,
    colour_of,
    resolve,
    words_of,
)
from planning.language.scene_facts import JointFact, SceneFacts, read_facts

SAME_FAILURES = 3  # after as many failures in the same words another try is no new information
_OF_JOINTS = ("open", "close", "pull")
# Words for shapes -> words of facts for the solids that have them.
SHAPES = {"round": "sphere|cylinder", "spherical": "sphere", "square": "box", "angular": "box", "boxy": "box"}


def opens(step: str, joint: str) -> bool:
    """Whether a step opens a joint, however far."""
    whole = Clause("open", joint).as_text()
    return step == whole or step.startswith(f"{whole} ")


@dataclass(frozen=True)
class Situation:
    """Everything that a plan is made from.

    Attributes:
        objects: Names in view.
        facts: What is seen of them.
        attempts: Failed steps so far.
        finished: Finished steps in order.
    """

    objects: tuple[str, ...]
    facts: SceneFacts
    attempts: tuple[FailedAttempt, ...] = ()
    finished: tuple[str, ...] = ()

    @classmethod
    def of(cls, fields: Mapping[str, Any]) -> "Situation":
        """From the fields of a planning contract."""
        return cls(
            tuple(fields["objects"]),
            read_facts(fields.get("facts", ())),
            tuple(fields.get("attempts", ())),
            tuple(fields.get("finished", ())),
        )

    def failures(self, step: str) -> list[FailedAttempt]:
        """Failed attempts at a step."""
        return [a for a in self.attempts if a.action == step]

    def openings_failed(self, joint: str) -> list[FailedAttempt]:
        """Failed attempts at opening a joint, however far."""
        return [a for a in self.attempts if opens(a.action, joint)]

    def was_opened(self, joint: str) -> bool:
        """Whether a step that opens a joint, however far, was finished."""
        return any(opens(step, joint) for step in self.finished)

    def hopeless(self, step: str) -> bool:
        """Whether a step failed in the same words again and again, and nothing was achieved in between."""
        last = self.failures(step)[-SAME_FAILURES:]
        alike = len(last) == SAME_FAILURES and len({(a.reason, a.after) for a in last}) == 1
        return alike and not last[0].reason.startswith(MOTION_FAILED) and last[-1].after == self.finished

    def done_since(self, attempt: FailedAttempt) -> Counter[str]:
        """Steps that were finished after a failed attempt."""
        return Counter(self.finished) - Counter(attempt.after)

    # -- what words mean -----------------------------------------------------------------------------------------

    def meant(self, clause: Clause) -> list[Clause]:
        """A clause with names of the scene; one about furniture becomes one for each of its joints.

        Raises:
            MissingName: A thing is neither in view nor can it be out of sight anywhere.
            AmbiguousName, GoalError: Several things, or one thing twice, may be meant.
        """
        if clause.kind in _OF_JOINTS or (clause.kind == "check" and clause.target is None):
            if not self.facts.seen:  # nobody says what can be moved: the words have to do
                return [clause.map_names(lambda p: next(iter(candidates(p, self.objects)), as_name(p)))]
            joints = self._joints_meant(clause.subject, clause.kind)
            return [Clause(clause.kind, j.name, None, clause.preposition) for j in joints]
        if clause.kind == "place" and words_of(str(clause.target))[-1] in SUPPORTS:
            return [self._put_down(self._thing_meant(clause.subject, clause))]
        named = clause.map_names(lambda phrase: self._thing_meant(phrase, clause))
        if named.subject == named.target:
            raise GoalError(f"'{clause.subject}' and '{clause.target}' both mean {named.subject}; name two things")
        return [named]

    def in_view(self, name: str) -> bool:
        """Whether a thing is seen."""
        return name in self.objects

    def _thing_meant(self, phrase: str, clause: Clause) -> str:
        if LIKE in phrase:
            return self._same_colour(phrase, clause)
        if words_of(phrase)[-1] in ANYTHING:
            return self._described(phrase)
        try:
            return resolve(phrase, self.objects)
        except MissingName:
            # What is out of sight may be behind a door; to look for it is the point of finding.
            if clause.kind == "find" or self._may_be_hidden(phrase):
                return next(iter(candidates(phrase, self.facts.unseen)), as_name(phrase))
            raise

    def _may_be_hidden(self, phrase: str) -> bool:
        looked_for = candidates(phrase, self.facts.unseen)
        return bool(looked_for) and any(not j.at_end for j in self.facts.joints.values() if j.role == "door")

    def _same_colour(self, phrase: str, clause: Clause) -> str:
        noun, like = phrase.split(LIKE)
        model, colour = self._model(like)
        if colour is None:
            raise GoalError(f"the colour of {model} is not known, so '{noun}' of the same colour cannot be told")
        others = (n for n in candidates(noun, self.objects) if n not in (model, clause.target))
        found = [n for n in others if self._colour(n) == colour]
        if len(found) != 1:
            known = ", ".join(f"{n} ({self._colour(n) or 'colour unknown'})" for n in candidates(noun, self.objects))
            raise GoalError(
                f"{'no' if not found else 'more than one'} '{noun}' has the colour of {model} ({colour}); "
                f"in view: {known or 'none'}"
            )
        return found[0]

    def _model(self, like: str) -> tuple[str, str | None]:
        """A thing whose colour is meant, in view or as it usually is ("the colour of a fruit"), and that colour."""
        if candidates(like, self.objects):
            model = resolve(like, self.objects)
            return model, self._colour(model)
        usual = builtin_catalogue().appearances.get(words_of(like)[-1])
        if usual is None or len(usual.colours) != 1:
            raise MissingName(like, self.objects)
        return as_name(like), usual.colours[0]

    def _described(self, phrase: str) -> str:
        """The one loose thing that words like "the round red thing" describe."""
        said = words_of(phrase)[:-1]
        colours = [w for w in said if w in builtin_catalogue().spoken_colours]
        shapes = [SHAPES[w] for w in said if w in SHAPES]
        if not said or len(said) > len(colours) + len(shapes):
            raise MissingName(phrase, self.objects)
        found = [
            name
            for name in self.objects
            if name not in self.facts.furniture
            and all(self._colour(name) == colour for colour in colours)
            and all(re.search(rf"\b(?:{shape}) of ", self.facts.seen.get(name, "")) for shape in shapes)
        ]
        if len(found) > 1:
            raise AmbiguousName(phrase, found)
        if not found:
            raise MissingName(phrase, self.objects)
        return found[0]

    def _put_down(self, name: str) -> Clause:
        """What "put it on the table" comes to: away from what carries it, or a look where it stands there already."""
        carrier = next((b for a, how, b in self.facts.relations if a == name and how in ("on", "in")), None)
        return Clause("find", name) if carrier is None else Clause("away", name, carrier)

    def _colour(self, name: str) -> str | None:
        return colour_of(name) or self.facts.colours.get(name)

    def _joints_meant(self, phrase: str, kind: str) -> list[JointFact]:
        joints = self.facts.joints
        name = as_name(phrase)
        if name in joints:
            return [joints[name]]
        roles = {"open": ("door", "lever"), "close": ("door", "lever"), "check": ("door", "lever")}.get(
            kind, ("lever", "plate", "door")
        )
        owners = candidates(phrase, sorted({j.owner for j in joints.values()}))
        found = [j for j in joints.values() if j.owner in owners and j.role in roles]
        if not found:  # "the left door", "the cabinet door"
            found = [j for j in joints.values() if j.role in roles and all_said_of(phrase, f"{j.name} {j.role}")]
        if len({j.owner for j in found}) > 1:
            names = " or ".join(sorted({j.owner for j in found}))
            raise GoalError(f"'{phrase}' may mean a part of {names}; say which one")
        if not found and candidates(phrase, self.objects):
            thing = candidates(phrase, self.objects)[0]
            raise GoalError(
                f"nothing is known of {thing} that can be moved like that; joints: {sorted(joints) or 'none'}"
            )
        if not found:
            raise MissingName(phrase, [*self.objects, *joints])
        return found
