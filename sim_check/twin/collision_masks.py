"""Twins in which the collision masks of some bodies are zero: these bodies have no contacts and do not move."""

import copy
from dataclasses import replace

from control.twin_model import TwinModel


def without_contacts(twin: TwinModel, names: tuple[str, ...]) -> TwinModel:
    """The twin in which some bodies neither touch anything nor fall, and are no obstacles."""
    model = copy.copy(twin.model)
    for name in names:
        body = model.body(name).id
        geoms = model.geom_bodyid == body
        model.geom_contype[geoms] = 0
        model.geom_conaffinity[geoms] = 0
        model.body_gravcomp[body] = 1.0
    return replace(twin, model=model, objects=tuple(o for o in twin.objects if o.name not in names))
