"""What all cameras together say of one name: one thing or several, a conflict of shapes, or why it was not seen."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from perception.catalogue.catalogue import Catalogue
from perception.catalogue.colour_words import colour_of
from perception.estimates import ObjectEstimate
from perception.geometry.prepared_frame import PreparedFrame
from perception.interfaces import Detector, ShapeDetector
from perception.known_shapes.forms import KnownForm
from perception.stages.known_shapes_first import may_have
from perception.stages.shape_conflicts import shape_conflict
from perception.tracking.instances import group_by_thing, instance_name
from perception.tracking.merging import merge


@dataclass(frozen=True)
class View:
    """What one camera gave.

    Attributes:
        found: Estimates by name.
        missing: Reasons by name.
    """

    found: Mapping[str, ObjectEstimate]
    missing: Mapping[str, str]


def agreed(
    name: str,
    views: Sequence[View],
    frames: Sequence[PreparedFrame],
    detector: Detector,
    form: KnownForm | None,
    instances: int,
    taken: Collection[str],
    catalogue: Catalogue | None = None,
) -> list[ObjectEstimate] | str:
    """Things of a name, at least one, what several cameras saw of each merged; or why there is none.

    Args:
        name: Scene name.
        views: Of all cameras.
        frames: Their pictures, in the same order.
        detector: Is asked whether another camera shows another shape, if it can tell.
        form: Sizes that the name means, or None.
        instances: How many things the name may be; the best is `name`, further ones name_2, name_3, ...
        taken: Names that are not free.
        catalogue: What colours look like; the built-in one if None.
    """
    phrase = name.replace("_", " ")
    seen = [[o for o in view.found.values() if o.phrase == phrase] for view in views]
    if not any(seen):
        return "; ".join(dict.fromkeys(view.missing[name] for view in views))
    all_seen = [o for view in seen for o in view]
    if instances == 1 and len(frames) > 1 and isinstance(detector, ShapeDetector):
        against = shape_conflict(phrase, all_seen, frames, detector)
        if against:
            return against
    # One name for one thing: what disagrees is a mistake, which `merge` leaves out.
    groups = group_by_thing(seen) if instances > 1 else [all_seen]
    merged = [merge(group) for group in groups[:instances]]
    if form is not None:
        merged = [thing for thing in merged if may_have(form, thing)]
        if not merged:
            return "what looks like it in the pictures has not its sizes"
    names: list[str] = []
    for i in range(len(merged)):
        names.append(instance_name(name, {*taken, *names}) if i else name)
    return [
        replace(thing, name=free, colour=colour_of(thing.evidence, frames, catalogue))
        for thing, free in zip(merged, names, strict=True)
    ]
