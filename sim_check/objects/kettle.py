"""Kettles: taken by a handle above the body, with a spout that gives them a direction."""

import numpy as np

from control.twin_model import Handle
from sim_check.objects.solids import Built, SolidShape

BODY, SPOUT = 0.66, 0.23  # body's share of the height; the spout's, beyond the body, of the length
BAR = 0.009  # radius of the handle in [m]; the hand can close on it, however large the kettle was seen


def kettle(name: str, sizes: np.ndarray) -> Built:
    """A round body, a spout towards +x, and above the body a bar along x on two posts.

    Args:
        name: Scene name, which the handle belongs to.
        sizes: Full sizes in [m], shape (3,).
    """
    half, bar = sizes / 2, BAR
    radius = min(float(half[1]), sizes[0] * (1 - SPOUT) / 2)
    middle = radius - half[0]  # x of the body's axis; the spout takes the rest
    lid = BODY * sizes[2] - half[2]
    height = half[2] - bar  # z of the bar's axis
    reach = 0.75 * radius
    level = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])  # z to x
    post = np.array([0.7 * bar, 0.7 * bar, (height - lid) / 2])
    spout = (half[0] - (middle + 0.8 * radius)) / 2
    solids = (
        SolidShape(
            "cylinder", np.array([radius, radius, (lid + half[2]) / 2]), np.array([middle, 0.0, (lid - half[2]) / 2])
        ),
        SolidShape("capsule", np.array([bar, bar, reach]), np.array([middle, 0.0, height]), level),
        SolidShape("cylinder", post, np.array([middle - reach, 0.0, (lid + height) / 2])),
        SolidShape("cylinder", post, np.array([middle + reach, 0.0, (lid + height) / 2])),
        SolidShape("cylinder", np.array([0.012, 0.012, spout]), np.array([half[0] - spout, 0.0, 0.6 * lid]), level),
    )
    handle = Handle(
        body=name,
        shape="capsule",
        centre=np.array([middle, 0.0, height]),
        axis=np.array([1.0, 0.0, 0.0]),
        outward=np.array([0.0, 0.0, 1.0]),
        half_length=reach - 0.01 - 0.7 * bar,
        half_width=bar,
        half_depth=bar,
        clearance=float(height - bar - lid),
    )
    return Built(solids, sizes, handle=handle)
