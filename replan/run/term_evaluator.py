"""Judges a reward term on what the cameras see: the last word on a subtask is the camera's, not the twin's."""

from collections.abc import Callable, Mapping

import numpy as np

from control.tasks.posed_object import Inside, PosedObject
from control.tasks.predicates import judge_term
from control.tasks.reward_spec import RewardTerm
from control.tasks.terms.views import TermJudgement
from perception.estimates import ObjectEstimate, SceneEstimate
from sim_check.cells.furniture_config import FurnitureConfig
from sim_check.furniture.build import furniture_model
from sim_check.objects.library import object_model


class SeenTermEvaluator:
    """Puts perceived objects and the measured hand into the definitions that the twin is judged by as well.

    Args:
        palm_position: Returns the tool centre point measured now, in the world in [m], shape (3,).
        rest_palm_position: Where it is in the rest configuration, in the world in [m], shape (3,).
        furniture: Kinds and sizes of the cell's furniture, by name.
    """

    def __init__(
        self,
        palm_position: Callable[[], np.ndarray],
        rest_palm_position: np.ndarray,
        furniture: Mapping[str, FurnitureConfig] | None = None,
    ) -> None:
        models = {name: furniture_model(name, config) for name, config in (furniture or {}).items()}
        self._insides = {
            name: Inside(room.low, room.high, room.outward)
            for name, model in models.items()
            for room in model.compartments[:1]
        }
        self._palm_position = palm_position
        self._rest_palm_position = rest_palm_position

    def __call__(self, term: RewardTerm, scene: SceneEstimate, before: SceneEstimate, /) -> TermJudgement:
        """Judge a term on `scene`; "away from" is measured from where things stood in `before`.

        Raises:
            UnknownObjectError: An object of the term is not seen now.
        """
        return judge_term(
            term,
            {o.name: self._posed(o) for o in scene.objects},
            self._palm_position(),
            self._rest_palm_position,
            {o.name: self._posed(o) for o in before.objects},
            support_height=scene.support_height,
            fractions={name: f for o in scene.objects for name, f in o.joint_fractions.items()},
        )

    def _posed(self, o: ObjectEstimate) -> PosedObject:
        """What is known of a container's inside comes from the object library, by its noun; the rest was measured."""
        thing = object_model(o.name, o.extents, o.shape)
        return PosedObject(
            name=o.name,
            pose=o.world_T_object,
            extents=np.asarray(o.extents),
            shape=o.shape,
            container=thing.container,
            inner_floor=thing.inner_floor,
            inner_radius=thing.inner_radius,
            inside=self._insides.get(o.name),
            tracked=False,
        )
