"""Whether a reward term is met: one definition for states of the twin and for scenes as perceived.

A term is judged on positions and sizes of objects and on how far joints are open, so the same words mean the same in
both worlds. Each judgement has a residual r >= 0, the distance in [m] that is left to go; a term is met exactly when
r = 0. Tolerances are wide enough that a perception error of 5 mm does not turn a result that is well met. What each
term means stands in its module of `control.tasks.terms` and in docs/reward-terms.md.
"""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from control.tasks.posed_object import PosedObject
from control.tasks.reward_spec import RewardTerm
from control.tasks.terms.views import SceneState, TermJudgement


def judge_term(
    term: RewardTerm,
    objects: Mapping[str, PosedObject],
    palm_position: np.ndarray,
    rest_palm_position: np.ndarray,
    start_objects: Mapping[str, PosedObject] | None = None,
    support_height: float = 0.0,
    fractions: Mapping[str, float] = MappingProxyType({}),
) -> TermJudgement:
    """Judge one term on a scene.

    Args:
        term: What is wanted.
        objects: Everything in the scene by name.
        palm_position: Tool centre point in the world in [m], shape (3,).
        rest_palm_position: Where the tool centre point is in the rest configuration in [m], shape (3,).
        start_objects: The scene before the motion. Where given, "away from b" is measured from where b stood then, so
            that pushing b away does not count.
        support_height: Height of the table top in [m].
        fractions: How far each joint is open, 0 closed .. 1 open, by name.

    Raises:
        UnknownObjectError: The term names an object that is not in `objects`, or a joint that is not in `fractions`.
    """
    term.check_names(frozenset(objects), frozenset(fractions))
    palm, rest = np.asarray(palm_position, float), np.asarray(rest_palm_position, float)
    scene = SceneState(objects, palm, rest, start_objects, support_height, fractions)
    return term.definition.judge(term, scene)
