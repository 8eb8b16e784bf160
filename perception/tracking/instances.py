"""Several things of one name: names for them, and which estimates of different cameras are of one thing."""

from collections.abc import Collection, Sequence

import numpy as np

from perception.estimates import ObjectEstimate
from perception.tracking.merging import agree


def instance_name(name: str, taken: Collection[str]) -> str:
    """The first of name, name_2, name_3, ... that is not taken."""
    count, free = 1, name
    while free in taken:
        count += 1
        free = f"{name}_{count}"
    return free


def group_by_thing(views: Sequence[Sequence[ObjectEstimate]]) -> list[list[ObjectEstimate]]:
    """Put together what several cameras saw of the same things, all of one phrase.

    Each estimate joins the nearest group that it agrees with (`perception.tracking.merging.agree`) and that holds
    nothing of its camera yet; where there is none it is a thing of its own.

    Args:
        views: Estimates of each camera, best first.

    Returns:
        At least one estimate each, best score first.
    """
    groups: list[list[ObjectEstimate]] = []
    for view in views:
        free = list(range(len(groups)))
        for estimate in view:
            fits = [g for g in free if agree(groups[g][0], estimate)]
            if not fits:
                groups.append([estimate])
                continue
            nearest = min(fits, key=lambda g: float(np.linalg.norm(groups[g][0].position - estimate.position)))
            groups[nearest].append(estimate)
            free.remove(nearest)
    return sorted(groups, key=lambda group: -max(e.score for e in group))
