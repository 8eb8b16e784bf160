"""What perception found, in sentences, and questions about it.

Facts are short sentences of a fixed form, made from estimates alone. They go into prompts: a vision model reads them
beside the pictures, the rule-based reasoner has nothing else.

    red_cube: box of 50 x 50 x 50 mm, centre at x 0.450, y 0.100, z 0.025 m
    yellow_cube is on crate
    kettle is in front of microwave
    microwave_door is a door of microwave and is closed
    the inside of microwave is hidden
    unnamed_1: box of 52 x 51 x 353 mm, centre at x 0.500, y 0.020, z 0.177 m; nobody named it
    apple is not in view: no box above the threshold
"""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from control.tasks.terms.joint_fraction import FRACTION_TOLERANCE
from perception.estimates import ObjectEstimate, SceneEstimate
from planning.language.answers import parse_question_type, parse_questions, parse_sentence, parse_yes_no
from planning.language.furnishings import KnownFurniture, KnownJoint
from planning.language.relations import find_relations
from planning.reasoners.reasoner import Asker

CLOSED = 0.08  # share of its way at which a joint still counts as closed: perceived doors err by two or three degrees
SEEN_INTO = 0.3  # share at which a door lets cameras look in


def describe(scene: SceneEstimate, furniture: Mapping[str, KnownFurniture] | None = None) -> tuple[str, ...]:
    """The facts of a scene: one line per object, relation, joint of furniture, hidden inside and name sought in vain.

    Args:
        scene: What is seen.
        furniture: What is known of furniture, by name.
    """
    known = [(furniture or {})[o.name] for o in scene.objects if o.name in (furniture or {})]
    fronts = {thing.name: thing.front for thing in known if thing.front is not None}
    objects = [f"{o.name}: {_solid(o)}" for o in scene.objects]
    relations = [str(r) for r in find_relations(scene, fronts)]
    joints = [f"{j.name} is a {j.role} of {j.owner} and is {_state(j, scene)}" for thing in known for j in thing.joints]
    hidden = [
        f"the inside of {thing.name} is hidden"
        for thing in known
        if thing.has_inside and all(_fraction(j, scene) < SEEN_INTO for j in thing.joints)
    ]
    unseen = [f"{u.name} is not in view: {u.reason}" for u in scene.unseen]
    return (*objects, *relations, *joints, *hidden, *unseen)


def about(action: str, facts: Sequence[str]) -> tuple[str, ...]:
    """Facts that name a thing of an action, or the furniture of its joint; sizes and places left out."""
    named = [w for w in re.findall(r"\w+", action) if any(w in re.findall(r"\w+", f) for f in facts)]
    owners = [m[1] for f in facts if (m := re.match(r"(?:\w+) is a \w+ of (\w+) ", f)) and f.split()[0] in named]
    wanted = {*named, *owners}
    return tuple(f for f in facts if ": " not in f and wanted & set(re.findall(r"\w+", f)))


def _solid(o: ObjectEstimate) -> str:
    size = " x ".join(f"{1000 * e:.0f}" for e in o.extents)
    x, y, z = o.position
    colour = f"{o.colour} " if getattr(o, "colour", None) else ""
    nobody = "" if o.named else "; nobody named it"
    return f"{colour}{o.shape} of {size} mm, centre at x {x:.3f}, y {y:.3f}, z {z:.3f} m{nobody}"


def _fraction(joint: KnownJoint, scene: SceneEstimate) -> float:
    owner = scene.get(joint.owner)
    return 0.0 if owner is None else float(owner.joint_fractions.get(joint.name, 0.0))


def _state(joint: KnownJoint, scene: SceneEstimate) -> str:
    """How far a joint is open, in the words of `planning.language.scene_facts`."""
    share = _fraction(joint, scene)
    if joint.role == "plate":
        # Its travel of some millimetres cannot be told from the errors of depth.
        return "pressed down by weights only"
    if share <= CLOSED:
        return "closed" if joint.role == "door" else "up"
    if share >= 1.0 - FRACTION_TOLERANCE:
        return "open" if joint.role == "door" else "pulled"
    return f"{100 * share:.0f} % {'open' if joint.role == 'door' else 'pulled'}"


class Perceiver:
    """Puts questions about the scene.

    Args:
        asker: Asks.
        facts: Says what is seen, in sentences.
        log: Gets `question` for questions that are not put, and `observation` for answers.
    """

    def __init__(self, asker: Asker, log, facts: Callable[[SceneEstimate], tuple[str, ...]] = describe) -> None:
        self._asker = asker
        self._facts = facts
        self._log = log

    def claims_to_see(self, name: str, scene: SceneEstimate, images: Sequence[Any]) -> bool:
        """Whether the perceiver sees something that the detector gave no pose for."""
        fields = {"object": name, "facts": self._facts(scene)}
        return self._asker.ask("perceive_object", fields, parse_yes_no, images)

    def observe(
        self,
        goal: str,
        plan: Sequence[str],
        action: str,
        scene: SceneEstimate,
        joints: Sequence[str],
        images: Sequence[Any],
    ) -> tuple[str, ...]:
        """Ask what a vision step needs to know.

        Returns:
            Observations: each a question with its answer.
        """
        sought = tuple(u.name for u in scene.unseen)
        known = (*scene.names, *joints, *sought)
        fields = {
            "goal": goal,
            "plan": plan,
            "action": action,
            "objects": scene.names,
            "joints": joints,
            "sought": sought,
        }
        questions = self._asker.ask("perception_questions", fields, lambda t: parse_questions(t, known))
        observations = []
        for question in questions:
            kind = self._asker.ask("question_type", {"question": question}, parse_question_type)
            if kind == "NEITHER":
                self._log("question", question=question, kind=kind, put=False)
                continue
            fields = {"question": question, "objects": scene.names, "facts": self._facts(scene)}
            answer = self._asker.ask("answer_question", fields, parse_sentence, images)
            self._log("observation", question=question, kind=kind, answer=answer)
            observations.append(f"{question} {answer}")
        return tuple(observations)
