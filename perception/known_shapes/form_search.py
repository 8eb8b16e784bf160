"""Things of a known form, looked for without a detector: every piece beyond support and furniture is tried."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from perception.catalogue.catalogue import Catalogue, builtin_catalogue
from perception.catalogue.colour_words import colour_of
from perception.estimates import ObjectEstimate
from perception.geometry.depth_rays import joined
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.support import SupportPlane
from perception.known_shapes.articulated_fit import KnownFit
from perception.known_shapes.fit_settings import FormSettings
from perception.known_shapes.fitted_estimates import form_estimate
from perception.known_shapes.form_fit import FormFit, fit_form
from perception.known_shapes.forms import KnownForm
from perception.known_shapes.residual_clusters import distance_to_known, pieces, residual_rays

STRIDE = 2  # every how many rows and columns of the pictures are used


def forms_of(names: Sequence[str], forms: Mapping[str, KnownForm]) -> dict[str, KnownForm]:
    """Which names mean a known form: those whose last word is its noun."""
    return {name: forms[noun] for name in names if (noun := name.rsplit("_", 1)[-1]) in forms}


def find_forms(
    frames: Sequence[PreparedFrame],
    asked: Mapping[str, KnownForm],
    table: SupportPlane,
    standing: Sequence[KnownFit],
    settings: FormSettings,
    catalogue: Catalogue | None = None,
) -> dict[str, list[ObjectEstimate]]:
    """Everything that has the form and the colour of a name.

    Args:
        frames: Pictures of one moment.
        asked: Forms by name.
        table: What things stand on.
        standing: Furniture that was found.
        settings: Of the fit.
        catalogue: Of colours; the built-in one if None.

    Returns:
        Estimates by name, the best agreeing first; an empty list where there is none.
    """
    rays = joined([frame.rays(STRIDE) for frame in frames])
    known = distance_to_known(rays, table, standing)
    parts = pieces(rays, residual_rays(rays, table, known))
    boards = [board for fit in standing for board in fit.model.carriers(fit.world_T_model)]
    found: dict[str, list[ObjectEstimate]] = {}
    for form in {form.noun: form for form in asked.values()}.values():
        fits = [fit_form(rays, known, piece, form, table, boards, settings) for piece in parts]
        good = sorted((f for f in fits if isinstance(f, FormFit)), key=lambda f: -f.agreeing)
        for name in (n for n, own in asked.items() if own is form):
            seen = [form_estimate(f, name, rays, frames, STRIDE, settings.model_std) for f in good]
            seen = [replace(o, colour=colour_of(o.evidence, frames, catalogue)) for o in seen]
            found[name] = [o for o in seen if _may_be(o.colour, name, catalogue or builtin_catalogue())]
    return found


def _may_be(colour: str | None, name: str, catalogue: Catalogue) -> bool:
    """Whether a thing of this colour, None if undecided, may be what a name with or without a colour says."""
    said = {catalogue.seen_colour(word) for word in name.split("_")[:-1]} - {None}
    return colour is None or not said or colour in said
