"""set_obj_z_position(a, z): object a is held with its centre at least at height z."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from control.tasks.posed_object import VERTICAL_TOLERANCE
from control.tasks.terms.definition import REST_POSITION, HandTask, NameArgument, NumberArgument, TermDefinition
from control.tasks.terms.lines import LineForm
from control.tasks.terms.maximize_distance import MaximizeDistance
from control.tasks.terms.minimize_distance import MinimizeDistance
from control.tasks.terms.views import Layout, SampledMotions, SceneState, TermJudgement

if TYPE_CHECKING:
    from control.tasks.reward_spec import RewardTerm

HEIGHT_TOLERANCE = 0.01  # [m], of a lifted object's centre


class SetObjectHeight(TermDefinition):
    """A height to hold.

    With z_a the height of a's centre in the world in [m]:

    judged:  r = max(0, z - `HEIGHT_TOLERANCE` - z_a) in [m]
    costed:  r = max(0, z - z_a) in [m]
    """

    name = "set_obj_z_position"
    names = (NameArgument("obj", "object"),)
    number = NumberArgument("z", "height", "m", 0.0, 2.0, -10.0, 10.0)
    prompt = "lifts an object to a height in metres"
    lines = (LineForm("height", "A is at height Z", "Z in metres", relocates=True),)
    hand = "holds the object up"
    met = f"the object's centre is at most {HEIGHT_TOLERANCE * 1e3:g} mm below the height"
    cost = "r = max(0, z - z_obj) in [m]; z_obj is the height of the object's centre"
    conflicts = (
        "the same object put down where its centre stays below the height; another object that has to be in the hand "
        "at the end as well (held up, or brought to the rest position)"
    )

    def judge(self, term: RewardTerm, scene: SceneState) -> TermJudgement:
        """On the height of the centre."""
        height = float(scene.objects[term.subject].position[2])
        residual = max(0.0, term.number - HEIGHT_TOLERANCE - height)
        text = f"the centre of {term.subject} is at {height * 1e3:.0f} mm (asked for {term.number * 1e3:.0f})"
        return TermJudgement(residual == 0.0, residual, text)

    def residual_along(self, term: RewardTerm, motions: SampledMotions) -> np.ndarray:
        """What is missing of the height, shape (n, t, 1)."""
        return np.maximum(0.0, term.number - motions.place(term.subject)[0][..., 2:])

    def asks_of_hand(self, term: RewardTerm) -> HandTask:
        """Hold it up."""
        return HandTask("lift", term.subject, None, term.number)

    def excludes(self, term: RewardTerm, other: RewardTerm, layout: Layout) -> str:
        """Put down lower than it is held, or two things in the hand at once."""
        if other.carries == term.subject:
            return _held_above(term, other, layout)
        if isinstance(other.definition, SetObjectHeight) and term.subject != other.subject:
            return _two_held(term, other, layout)
        brought = isinstance(other.definition, MinimizeDistance) and REST_POSITION in (other.subject, other.target)
        return _two_held(term, other, layout) if brought and other.carries else ""


def _held_above(lift: RewardTerm, put: RewardTerm, layout: Layout) -> str:
    """A height that the thing does not have where the other term puts it down."""
    thing, height = layout.objects.get(lift.subject), lift.number
    if thing is None or layout.table is None:
        return ""
    if isinstance(put.definition, MaximizeDistance):
        top, where = layout.table + VERTICAL_TOLERANCE, "on the table"
    else:
        to = layout.objects.get(str(put.destination))
        if to is None:
            return ""
        # Inside furniture a thing ends lower than on its top, in a bowl about as low as its rim: a bound from above.
        top, where = to.top + VERTICAL_TOLERANCE, f"at '{to.name}'"
    # As it stands or on its longest side: the highest that its centre can be.
    centre = top + float(np.max(thing.extents)) / 2
    if centre >= height - HEIGHT_TOLERANCE:
        return ""
    return f"put down {where}, the centre of '{thing.name}' is no higher than {centre:.2f} m, not {height:g} m"


def _two_held(a: RewardTerm, b: RewardTerm, layout: Layout) -> str:
    """Two things that have to be in the hand at the end; one that stands high enough need not be."""
    for term in (a, b):
        if not isinstance(term.definition, SetObjectHeight):
            continue
        thing = layout.objects.get(term.subject)
        if thing is None or float(thing.position[2]) >= term.number - HEIGHT_TOLERANCE:
            return ""
    first, second = a.carries or a.subject, b.carries or b.subject
    return f"the hand can hold one of '{first}' and '{second}' only"
