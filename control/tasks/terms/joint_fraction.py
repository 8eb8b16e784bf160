"""set_joint_fraction(j, f): joint j of furniture stands at fraction f of its range, 0 closed .. 1 open.

Opening and closing are one definition: a door counts as closed when it stands closed, not when nothing was done to it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from control.tasks.terms.definition import HandTask, NameArgument, NumberArgument, TermDefinition
from control.tasks.terms.lines import LineForm
from control.tasks.terms.views import Layout, SampledMotions, SceneState, TermJudgement

if TYPE_CHECKING:
    from control.tasks.reward_spec import RewardTerm

# Share of a joint's range: 5.4 degrees of a door that turns by 1.9 rad. Perceived doors are off by two or three.
FRACTION_TOLERANCE = 0.05


class SetJointFraction(TermDefinition):
    """A joint at a fraction of its range.

    judged:  r = max(0, |f_j - f| - `FRACTION_TOLERANCE`), a share of the range
    costed:  r = l |q_j - q(f)| in [m], with l the handle's distance from a hinge's axis in [m], 1 for a slide
    """

    name = "set_joint_fraction"
    names = (NameArgument("joint", "joint"),)
    number = NumberArgument("fraction", "fraction", "", 0.0, 1.0, 0.0, 1.0)
    prompt = "0 is closed, 1 is open"
    lines = (
        LineForm("open", "J is open", value=1.0),
        LineForm("open", "J is N % open", "N a whole number, where all the way is not possible or not needed"),
        LineForm("closed", "J is closed", value=0.0),
    )
    hand = (
        "takes the joint's handle along until it stands there, opening or closing. One that stands there already asks "
        "for nothing"
    )
    met = f"the joint stands within {FRACTION_TOLERANCE:.0%} of its range of the fraction"
    cost = "r = l |q_j - q(fraction)| in [m]: the way of its handle; l is the lever of a hinge in [m], 1 of a slide"
    conflicts = "the same joint at another fraction, further away than both tolerances"

    def judge(self, term: RewardTerm, scene: SceneState) -> TermJudgement:
        """The residual is a share of the joint's range, not a distance."""
        fraction, wanted = scene.fractions[term.subject], term.number
        residual = max(0.0, abs(fraction - wanted) - FRACTION_TOLERANCE)
        text = f"{term.subject} is {fraction:.0%} open (asked for {wanted:.0%})"
        return TermJudgement(residual == 0.0, residual, text)

    def residual_along(self, term: RewardTerm, motions: SampledMotions) -> np.ndarray:
        """What the handle has still to go, shape (n, t, 1)."""
        return motions.handle_way(term.subject, term.number)[..., None]

    def asks_of_hand(self, term: RewardTerm) -> HandTask:
        """Move the joint by its handle."""
        return HandTask("drive", term.subject, None, term.number)

    def excludes(self, term: RewardTerm, other: RewardTerm, layout: Layout) -> str:
        """The same joint at two fractions."""
        if not isinstance(other.definition, SetJointFraction) or term.subject != other.subject:
            return ""
        if abs(term.number - other.number) <= 2 * FRACTION_TOLERANCE:
            return ""
        return f"'{term.subject}' can stand at one fraction only"
