"""Two looks of a world in which nothing but the arm has moved: what stood there still stands there."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from perception.estimates import ObjectEstimate, SceneEstimate
from perception.tracking.instances import instance_name

UNNAMED = "unnamed"  # names of things that depth shows and nobody named: unnamed_1, unnamed_2, ...


def unchanged(before: SceneEstimate, now: SceneEstimate, anew: Collection[str] = ()) -> SceneEstimate:
    """What is known after a further look from elsewhere.

    Estimates of the first look stay, as it was taken to see things; a further one may be taken to see space, with the
    arm in the picture. What it shows besides is added: names that were not seen before, and unnamed things where none
    stood.

    Args:
        before: The first look.
        now: The further one.
        anew: Names that the further look was taken for: of their two estimates, the one without doubts, else the one
            whose place is better known.
    """
    kept = [_better(o, now.get(o.name)) if o.name in anew else o for o in before.objects]
    names = {o.name for o in kept}
    for thing in now.objects:
        if _unnamed(thing):
            if not any(_overlap(thing, other) for other in kept):
                kept.append(replace(thing, name=_free_name(names)))
        elif thing.name not in names:
            kept.append(thing)
        names.add(kept[-1].name)
    unseen = tuple(u for u in now.unseen if u.name not in names)
    return replace(now, objects=tuple(kept), unseen=unseen, support_height=before.support_height)


def _better(before: ObjectEstimate, now: ObjectEstimate | None) -> ObjectEstimate:
    def ill_known(o: ObjectEstimate) -> tuple[bool, float]:
        return bool(o.doubts), float(np.max(o.position_std[:2]))

    return before if now is None else min(now, before, key=ill_known)


def _unnamed(thing: ObjectEstimate) -> bool:
    return thing.name.rpartition("_")[0] == UNNAMED


def _free_name(taken: Collection[str]) -> str:
    return f"{UNNAMED}_1" if f"{UNNAMED}_1" not in taken else instance_name(UNNAMED, {UNNAMED, *taken})


def _overlap(a: ObjectEstimate, b: ObjectEstimate) -> bool:
    """Whether the spheres in two boxes' horizontal outlines, of half their diagonals, meet, and their heights do."""
    apart = np.abs(a.position - b.position)
    reach = (np.linalg.norm(a.extents[:2]) + np.linalg.norm(b.extents[:2])) / 2
    return bool(np.linalg.norm(apart[:2]) < reach and apart[2] < (a.extents[2] + b.extents[2]) / 2)
