"""What perception found, in sentences, and questions about it.

Facts are short sentences of a fixed form, made from estimates alone. They go into prompts: a vision model reads them
beside the pictures, the rule-based reasoner has nothing else.

    red_cube: box of 50 x 50 x 50 mm, centre at x 0.450, y 0.100, z 0.025 m
    yellow_cube is on crate
    apple is not in view: no box above the threshold
"""

from collections.abc import Sequence
from typing import Any

from perception.estimates import ObjectEstimate, SceneEstimate
from planning.answers import parse_question_type, parse_questions, parse_sentence, parse_yes_no
from planning.reasoner import Asker
from planning.relations import find_relations


def describe(scene: SceneEstimate) -> tuple[str, ...]:
    """The facts of a scene: one line per object, one per relation, one per name looked for in vain."""
    objects = [f"{o.name}: {_solid(o)}" for o in scene.objects]
    relations = [str(r) for r in find_relations(scene)]
    unseen = [f"{u.name} is not in view: {u.reason}" for u in scene.unseen]
    return (*objects, *relations, *unseen)


def _solid(o: ObjectEstimate) -> str:
    size = " x ".join(f"{1000 * e:.0f}" for e in o.extents)
    x, y, z = o.position
    return f"{o.shape} of {size} mm, centre at x {x:.3f}, y {y:.3f}, z {z:.3f} m"


class Perceiver:
    """Puts questions about the scene.

    Args:
        asker: Asks.
        log: Gets `question` for questions that are not put, and `observation` for answers.
    """

    def __init__(self, asker: Asker, log) -> None:
        self._asker = asker
        self._log = log

    def claims_to_see(self, name: str, scene: SceneEstimate, images: Sequence[Any]) -> bool:
        """Whether the perceiver sees something that the detector gave no pose for."""
        fields = {"object": name, "facts": describe(scene)}
        return self._asker.ask("perceive_object", fields, parse_yes_no, images)

    def observe(
        self, goal: str, plan: Sequence[str], action: str, scene: SceneEstimate, images: Sequence[Any]
    ) -> tuple[str, ...]:
        """Ask what a vision step needs to know.

        Returns:
            Observations: each a question with its answer.
        """
        sought = tuple(u.name for u in scene.unseen)
        known = (*scene.names, *sought)
        fields = {"goal": goal, "plan": plan, "action": action, "objects": scene.names, "sought": sought}
        questions = self._asker.ask("perception_questions", fields, lambda t: parse_questions(t, known))
        observations = []
        for question in questions:
            kind = self._asker.ask("question_type", {"question": question}, parse_question_type)
            if kind == "NEITHER":
                self._log("question", question=question, kind=kind, put=False)
                continue
            fields = {"question": question, "objects": scene.names, "facts": describe(scene)}
            answer = self._asker.ask("answer_question", fields, parse_sentence, images)
            self._log("observation", question=question, kind=kind, answer=answer)
            observations.append(f"{question} {answer}")
        return tuple(observations)
