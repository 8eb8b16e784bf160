"""Forms of the object library as perception knows them: those of nouns that no single solid is."""

import numpy as np

from perception.catalogue.catalogue import Catalogue
from perception.known_shapes.forms import FormSolid, KnownForm
from sim_check.models.scene_mjcf import pose_of
from sim_check.objects.library import known_nouns, object_model


def known_forms(catalogue: Catalogue | None = None) -> dict[str, KnownForm]:
    """Forms by noun of a catalogue, the built-in one if None.

    Vessels are left out, because perception fits them as what they are.
    """
    models = {noun: object_model(noun, catalogue=catalogue) for noun in known_nouns(catalogue)}
    return {
        noun: KnownForm(noun, model.extents, lambda sizes, noun=noun: _solids(noun, sizes, catalogue))
        for noun, model in models.items()
        if len(model.solids) > 1 and not model.container
    }


def _solids(noun: str, sizes: np.ndarray, catalogue: Catalogue | None) -> tuple[FormSolid, ...]:
    return tuple(
        FormSolid("ellipsoid" if s.kind == "sphere" else s.kind, s.half, pose_of(s.position, s.quat))
        for s in object_model(noun, sizes, catalogue=catalogue).solids
    )
