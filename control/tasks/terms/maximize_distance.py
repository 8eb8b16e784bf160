"""maximize_l2_distance(a, b, d): a is put on the table at least d from where b stood, or the palm draws back from b."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from control.tasks.posed_object import VERTICAL_TOLERANCE, half_heights
from control.tasks.terms.definition import (
    PALM,
    PLACES,
    REST_POSITION,
    HandTask,
    NameArgument,
    NumberArgument,
    TermDefinition,
    brought,
)
from control.tasks.terms.lines import LineForm
from control.tasks.terms.views import SampledMotions, SceneState, TermJudgement

if TYPE_CHECKING:
    from control.tasks.reward_spec import RewardTerm

DISTANCE_TOLERANCE = 0.01  # [m], of a horizontal distance to keep
SUPPORT = "table"


class MaximizeDistance(TermDefinition):
    """A distance to keep.

    With p_a, p_b the centres in [m] (of b where it stood at the start, so that pushing b away does not count), |.|_h a
    horizontal length and z the height of a's underside above the table in [m]:

    judged:  r = |(max(0, d - tol - |p_a - p_b|_h), max(0, |z| - tol_z))| in [m]; with the palm or the rest position as
             a: r = max(0, d - tol - |p_a - p_b|)
    costed:  r = (max(0, d - |p_a - p_b|_h), z) in [m]; with the palm or the rest position as a:
             r = max(0, d - |p_a - p_b|)
    """

    name = "maximize_l2_distance"
    names = (NameArgument("a", "place"), NameArgument("b", "place"))
    number = NumberArgument("distance", "distance", "m", 0.01, 2.0, 0.0, 10.0, default=0.5)
    prompt = "keeps a at least that many metres away from b"
    lines = (LineForm("far", "A is far from B"),)
    hand = "puts a on the table, at least the distance from where b stood. With `palm`: draws back"
    met = (
        f"the horizontal distance of the centres is at most {DISTANCE_TOLERANCE * 1e3:g} mm short of it and a's "
        f"underside is within {VERTICAL_TOLERANCE * 1e3:g} mm of the table; with `palm` first, its distance alone"
    )
    cost = (
        "r = (max(0, distance - |p_a - p_b|), z) in [m]; p are the centres, their distance is horizontal, z is the "
        "height of a's underside above the table; with `palm` first r = max(0, distance - |p_palm - p_b|)"
    )
    conflicts = (
        "see `minimize_l2_distance_reward` (near the same thing, or near a neighbour of it) and "
        "`set_obj_z_position_reward` (held up)"
    )

    def judge(self, term: RewardTerm, scene: SceneState) -> TermJudgement:
        """Distances are measured from where things stood at the start, where that is known."""
        if term.subject in PLACES:
            return _judge_distance(term, scene)
        a, second, wanted = scene.objects[term.subject], str(term.target), term.number
        reference = scene.objects if scene.start_objects is None else scene.start_objects
        if second in PLACES:
            other = scene.palm if second == PALM else scene.rest_palm
        else:
            other = reference[second].position if second in reference else scene.objects[second].position
        distance = float(np.linalg.norm(a.position[:2] - other[:2]))
        short = max(0.0, wanted - DISTANCE_TOLERANCE - distance)
        height = abs(a.bottom - scene.support_height)
        above = max(0.0, height - VERTICAL_TOLERANCE)
        residual = float(np.hypot(short, above))
        text = f"{a.name} is {distance * 1e3:.0f} mm from {second} (asked for {wanted * 1e3:.0f} mm)"
        if above:
            text += f" and {height * 1e3:.0f} mm off the {SUPPORT}"
        return TermJudgement(residual == 0.0, residual, text)

    def residual_along(self, term: RewardTerm, motions: SampledMotions) -> np.ndarray:
        """What is missing of the distance, shape (n, t, 1); of an object its height as well, shape (n, t, 2)."""
        first, second, wanted = term.subject, str(term.target), term.number
        points = {PALM: motions.palm, REST_POSITION: motions.rest_palm[None, None]}
        if first in PLACES:
            other = points[second] if second in points else motions.place(second)[0]
            return np.maximum(0.0, wanted - np.linalg.norm(points[first] - other, axis=-1))[..., None]
        centre, turn = motions.place(first)
        other = points[second] if second in points else motions.start[second].position[None, None]
        missing = np.maximum(0.0, wanted - np.linalg.norm((centre - other)[..., :2], axis=-1))
        above = centre[..., 2] - half_heights(motions.start[first], turn) - motions.support_height
        return np.stack(np.broadcast_arrays(missing, above), axis=-1)

    def asks_of_hand(self, term: RewardTerm) -> HandTask:
        """Put the object down far away; with the palm or the rest position first, draw back."""
        first, second = term.subject, term.target
        if first in PLACES:
            return HandTask("retreat", None, second if first == PALM else first, term.number)
        return HandTask("away", first, second, term.number)

    def carries(self, term: RewardTerm) -> str | None:
        """Of two objects the first, beside the rest position the object, beside the palm none."""
        return brought(term)

    def handles(self, term: RewardTerm) -> str | None:
        """The first object; nothing where only the palm moves."""
        return self.carries(term)


def _judge_distance(term: RewardTerm, scene: SceneState) -> TermJudgement:
    """The palm or the rest position from something: only a distance."""
    first, second = term.subject, str(term.target)
    points = {PALM: scene.palm, REST_POSITION: scene.rest_palm}
    other = points[second] if second in points else scene.objects[second].position
    distance = float(np.linalg.norm(points[first] - other))
    residual = max(0.0, term.number - DISTANCE_TOLERANCE - distance)
    return TermJudgement(residual == 0.0, residual, f"{first} is {distance * 1e3:.0f} mm from {second}")
