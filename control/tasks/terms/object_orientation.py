"""set_obj_orientation(a, t): object a is turned by t about its own x axis from how it stood, in whatever heading.

Where attitudes are tracked (the twin), a turn is judged on them. A camera that fits upright boxes cannot tell which of
a box's faces is up: there a turn is judged on the height that it gives the object, and says so.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from control.robot.rotations import rolled, rotation_exp
from control.tasks.posed_object import VERTICAL_TOLERANCE, PosedObject
from control.tasks.terms.definition import HandTask, NameArgument, NumberArgument, TermDefinition
from control.tasks.terms.views import Layout, SampledMotions, SceneState, TermJudgement

if TYPE_CHECKING:
    from control.tasks.reward_spec import RewardTerm

TURN_TOLERANCE = 0.17  # [rad], of an object's tilt: it lies flat or it does not


class SetObjectOrientation(TermDefinition):
    """An object turned over.

    With u the direction that is up in the object's own axes, u_w where a turn about x by t takes the one of the start,
    and h half of the object's longest side in [m]:

    judged:  r = h max(0, angle(u, u_w) - `TURN_TOLERANCE`) in [m]
    costed:  r = h (u - u_w) in [m], 3 components
    """

    name = "set_obj_orientation"
    names = (NameArgument("obj", "object"),)
    number = NumberArgument(
        "x_axis_rotation_radians", "rotation", "rad", -2 * math.pi, 2 * math.pi, -2 * math.pi, 2 * math.pi
    )
    prompt = "turns an object"
    hand = "turns it about its own x axis from how it stood, in whatever heading, and puts it down"
    met = (
        f"what is up in the object's own axes is within {TURN_TOLERANCE:g} rad of where the turn takes it; of an "
        f"object whose attitude is not tracked, its height is within {VERTICAL_TOLERANCE / 2 * 1e3:g} mm of a turned "
        "one's"
    )
    cost = (
        "r = h (u - u_w) in [m]; u is up in the object's own axes, u_w where the turn takes it, h half of the longest "
        "side in [m]"
    )
    conflicts = "the same object turned by another angle, further away than both tolerances"

    def judge(self, term: RewardTerm, scene: SceneState) -> TermJudgement:
        """The direction that is up, in the object's own axes, against where the turn takes the one of the start."""
        a, angle = scene.objects[term.subject], term.number
        start = a if scene.start_objects is None else scene.start_objects.get(a.name, a)
        if not a.tracked:
            return _judge_height(a, start, angle)
        between = float(np.arccos(np.clip(a.pose[2, :3] @ _wanted_up(start, angle), -1.0, 1.0)))
        residual = max(0.0, between - TURN_TOLERANCE) * float(np.max(a.extents)) / 2
        asked = f"where a turn by {np.degrees(angle):.0f} would take it"
        return TermJudgement(residual == 0.0, residual, f"{a.name} is {np.degrees(between):.0f} degrees from {asked}")

    def residual_along(self, term: RewardTerm, motions: SampledMotions) -> np.ndarray:
        """Way in [m] of the end of the longest side, shape (n, t, 3)."""
        start = motions.start[term.subject]
        _, rotations = motions.place(term.subject)
        return (rotations[..., 2, :] - _wanted_up(start, term.number)) * float(np.max(start.extents)) / 2

    def asks_of_hand(self, term: RewardTerm) -> HandTask:
        """Turn it over and put it down near where it stood."""
        return HandTask("turn", term.subject, None, term.number)

    def excludes(self, term: RewardTerm, other: RewardTerm, layout: Layout) -> str:
        """The same object by two angles."""
        if not isinstance(other.definition, SetObjectOrientation) or term.subject != other.subject:
            return ""
        apart = abs((term.number - other.number + np.pi) % (2 * np.pi) - np.pi)
        return f"'{term.subject}' can be turned by one angle only" if apart > 2 * TURN_TOLERANCE else ""

    def turns_by(self, term: RewardTerm) -> float | None:
        """The angle that is asked for."""
        return term.number


def _wanted_up(start: PosedObject, angle: float) -> np.ndarray:
    """Up in the object's own axes, shape (3,), after a turn of the start about x by `angle` [rad]."""
    return rotation_exp(np.array([-angle, 0.0, 0.0])) @ start.pose[2, :3]


def _judge_height(a: PosedObject, start: PosedObject, angle: float) -> TermJudgement:
    turned = replace(start, pose=rolled(start.pose, 0, angle))
    residual = max(0.0, abs(a.half_height - turned.half_height) - VERTICAL_TOLERANCE / 2)
    text = (
        f"{a.name} is {2e3 * a.half_height:.0f} mm high, as far as it can be seen "
        f"(turned as asked it is {2e3 * turned.half_height:.0f})"
    )
    return TermJudgement(residual == 0.0, residual, text)
