"""Twins without some bodies, in thought: ghosts touch nothing, nothing touches them, and they stay where they are."""

import copy
from dataclasses import replace

from control.twin_model import TwinModel


def ghosted(twin: TwinModel, names: tuple[str, ...]) -> TwinModel:
    """The twin in which some bodies neither touch anything nor fall, and are no obstacles."""
    model = copy.copy(twin.model)
    for name in names:
        body = model.body(name).id
        geoms = model.geom_bodyid == body
        model.geom_contype[geoms] = 0
        model.geom_conaffinity[geoms] = 0
        model.body_gravcomp[body] = 1.0
    return replace(twin, model=model, objects=tuple(o for o in twin.objects if o.name not in names))
