"""What is known by its shape is found first, in the depth of all cameras together and without a detector.

A detector is asked only about what is left, and where more things have a form than were asked for.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from perception.catalogue.catalogue import Catalogue
from perception.detection.nms import box_iou
from perception.estimates import ObjectEstimate, SceneEstimate
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.solids import Solid
from perception.interfaces import Detection
from perception.known_shapes.articulated_fit import KnownFit, fit_known
from perception.known_shapes.fit_settings import FormSettings, KnownSettings
from perception.known_shapes.fitted_estimates import known_estimate
from perception.known_shapes.form_search import find_forms, forms_of
from perception.known_shapes.forms import KnownForm
from perception.known_shapes.models import KnownModel
from perception.tracking.instances import instance_name

# Sides of a thing of a known form against its usual ones, shortest with shortest: partly hidden, or a big one.
LEAST_SHARE, MOST_SHARE = 0.4, 1.5


@dataclass(frozen=True)
class ShapesFound:
    """What was found by its shape.

    Attributes:
        models: Estimates of things of known shape, or why there is none, by name.
        formed: Everything that has the form and colour of a name, by name, the best agreeing first; never empty.
        forms: Forms that names mean, by name, found or not.
        boards: Boards of what was found, on whose tops things may stand.
    """

    models: Mapping[str, ObjectEstimate | str]
    formed: Mapping[str, Sequence[ObjectEstimate]]
    forms: Mapping[str, KnownForm]
    boards: tuple[Solid, ...]


def find_shapes(
    frames: Sequence[PreparedFrame],
    names: Sequence[str],
    known: Mapping[str, KnownModel],
    forms: Mapping[str, KnownForm],
    before: SceneEstimate | None,
    catalogue: Catalogue | None = None,
) -> ShapesFound:
    """Look for those names whose shape or form is known.

    Args:
        frames: Pictures of one moment.
        names: All names that were asked for.
        known: Models by name.
        forms: Forms by noun.
        before: What an earlier look saw: models are looked for there first.
        catalogue: What colours look like; the built-in one if None.
    """
    asked = [known[name] for name in names if name in known]
    table = next((frame.support for frame in frames if frame.support.seen), frames[0].support)
    fits = fit_known(frames, asked, table, KnownSettings(), _stood(asked, before)) if asked else {}
    standing = [fit for fit in fits.values() if isinstance(fit, KnownFit)]
    of_form = forms_of([name for name in names if name not in fits], forms)
    formed = find_forms(frames, of_form, table, standing, FormSettings(), catalogue) if of_form else {}
    return ShapesFound(
        {name: known_estimate(fit, frames) if isinstance(fit, KnownFit) else fit for name, fit in fits.items()},
        {name: seen for name, seen in formed.items() if seen},
        of_form,
        tuple(board for fit in standing for board in fit.model.carriers(fit.world_T_model)),
    )


def likeliest(
    seen: Sequence[ObjectEstimate], instances: int, boxes: Callable[[str], Mapping[str, Sequence[Detection]]]
) -> list[ObjectEstimate]:
    """At most `instances` of the things that have one form; if there are more, those that a detector finds best.

    Args:
        seen: Of one phrase, the best agreeing first.
        instances: How many the name may be.
        boxes: The detector's boxes for a phrase, by camera; asked only if there are more.
    """
    if len(seen) > instances:
        found = boxes(seen[0].phrase)

        def liking(thing: ObjectEstimate) -> float:
            pairs = [(e, box) for e in thing.evidence for box in found[e.camera]]
            return sum(box.score * float(box_iou(e.box_px, box.box_px)[0, 0]) for e, box in pairs)

        seen = sorted(seen, key=liking, reverse=True)[:instances]
    names: list[str] = []
    for thing in seen:
        names.append(instance_name(thing.name, names))
    return [replace(thing, name=name) for thing, name in zip(seen, names, strict=True)]


def may_have(form: KnownForm, seen: ObjectEstimate) -> bool:
    """Whether something of these sizes, a part of it maybe hidden, can be of a form."""
    shares = np.sort(np.asarray(seen.extents)) / np.sort(np.asarray(form.extents))
    return bool(shares.min() >= LEAST_SHARE and shares.max() <= MOST_SHARE)


def _stood(models: Sequence[KnownModel], before: SceneEstimate | None) -> dict[str, np.ndarray]:
    """Place, turn and fractions of those models that an earlier look saw, by name."""
    seen = [(model, before.get(model.name)) for model in models] if before else []
    return {
        model.name: np.array([*o.position[:2], o.yaw, *(o.joint_fractions.get(p.name, 0.0) for p in model.parts)])
        for model, o in seen
        if o is not None
    }
