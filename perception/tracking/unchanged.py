"""Two looks of a world in which nothing but the arm has moved: what stood there still stands there."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from perception.estimates import ObjectEstimate, SceneEstimate


def unchanged(before: SceneEstimate, now: SceneEstimate, anew: Collection[str] = ()) -> SceneEstimate:
    """What is known after a further look from elsewhere.

    Estimates of the first look stay, as it was taken to see things; a further one may be taken to see space, with the
    arm in the picture. Names that were not seen before are added.

    Args:
        before: The first look.
        now: What was found by name in the further one.
        anew: Names that the further look was taken for: of their two estimates, the one without doubts, else the one
            whose place is better known.
    """
    kept = [_better(o, now.get(o.name)) if o.name in anew else o for o in before.objects]
    known = {o.name for o in kept}
    kept += [o for o in now.objects if o.name not in known]
    unseen = tuple(u for u in now.unseen if u.name not in {o.name for o in kept})
    return replace(now, objects=tuple(kept), unseen=unseen, support_height=before.support_height)


def _better(before: ObjectEstimate, now: ObjectEstimate | None) -> ObjectEstimate:
    def ill_known(o: ObjectEstimate) -> tuple[bool, float]:
        return bool(o.doubts), float(np.max(o.position_std[:2]))

    return before if now is None else min(now, before, key=ill_known)
