"""Which solid a thing is, where its name does not say so: the one that its points lie on.

Solids of different freedom are compared by what their points leave over (Bayesian information criterion):

    score = n log(mean min(d, 3 s)^2 + f^2) + k log(n) + m log(o^2 + p^2)

with the distances d of the points to the surface, the spread s of a point, what a first fit leaves f, the number n of
points that err independently and the number k of the solid's free sizes and places. Depth blunts edges and the outline
shows them: m pieces of it disagree with the solid's by o, where an edge is known to p. The lowest score wins.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from perception.catalogue.appearance import Appearance, Kind
from perception.geometry.refinement import Refined
from perception.geometry.solids import Solid, fit_box, fit_cylinder, fit_sphere
from perception.geometry.surface_distance import surface_distance

FREEDOM: dict[Kind, int] = {"box": 7, "cylinder": 5, "sphere": 4, "lying cylinder": 5, "ellipsoid": 7}
ANY_KIND: tuple[Kind, ...] = ("box", "cylinder", "sphere", "lying cylinder")  # what an unknown noun may mean
EDGES, OUTLINE_PX = 15.0, 0.5  # pieces of outline that err independently, and how well an edge is known in [px]
PATCHES = 40.0  # points that err independently are seldom more
TEMPER = 20.0  # scores that differ by less are no reason to be sure: points err together, and solids are rough models
FIT_STD = 0.0015  # how far a first fit is off its own points in [m]
LYING_STD = 0.003  # what noise, mask and a bent label leave on a lying can's ends and axis in [m]


def kinds_of(appearance: Appearance) -> tuple[Kind, ...]:
    """Solids that a noun may mean. Cans may lie, and some are no cylinders; a noun that is not known says nothing."""
    if appearance.noun is None:
        return ANY_KIND
    if appearance.kinds:
        return appearance.kinds
    if appearance.solid == "cylinder" and not appearance.hollow:
        return ("cylinder", "lying cylinder")
    return (appearance.solid,)


def first_fits(points: np.ndarray, kinds: Sequence[Kind], bottom: float, depth_std: float) -> dict[Kind, Solid]:
    """First fits of every kind of solid that a thing may be.

    Args:
        points: In the world in [m], shape (n, 3).
        kinds: What it may be; at least one.
        bottom: Height of the supporting surface in [m].
        depth_std: Spread of one point in [m].
    """
    fits: dict[Kind, Solid] = {}
    for kind in kinds:
        if kind in ("sphere", "ellipsoid"):
            fits[kind] = fit_sphere(points)
        elif kind == "cylinder":
            fits[kind] = fit_cylinder(points, bottom, depth_std)
        elif kind == "lying cylinder":
            fits[kind] = fit_lying_cylinder(points, bottom)
        else:
            fits[kind] = fit_box(points, bottom, depth_std)
    return fits


def lying(solid: Solid, depth_std: float) -> Refined:
    """A lying cylinder as it is reported: the box of its length and diameter, with its spread."""
    spread = np.full(3, LYING_STD + depth_std / 3.0)
    yaw_std = float(np.arctan2(2.0 * LYING_STD, solid.extents[0]))
    return Refined(solid, spread, yaw_std, float("nan"), 2.0 * spread)


def best_of(
    first: Mapping[Kind, Solid], refined: Mapping[Kind, Refined], points: np.ndarray, depth_std: float
) -> tuple[Kind, dict[Kind, float]]:
    """The kind that points and outline speak for, and how likely each of them is, which sums to 1.

    Args:
        first: First fits, which hold to the points alone.
        refined: The same after refinement, which know how far their outlines disagree.
        points: In the world in [m], shape (n, 3).
        depth_std: Spread of one point in [m].
    """
    # A lying cylinder's outline is not fitted: it counts as well as the best of the others, and points decide.
    off = {kind: fit.outline_rms for kind, fit in refined.items()}
    least = min((rms for rms in off.values() if np.isfinite(rms)), default=0.0)
    scores: dict[Kind, float] = {
        kind: _score(kind, solid, points, depth_std)
        + EDGES * float(np.log((off[kind] if np.isfinite(off[kind]) else least) ** 2 + OUTLINE_PX**2))
        for kind, solid in first.items()
        # What is shorter than wide does not stay on its edge.
        if kind != "lying cylinder" or len(first) == 1 or solid.extents[0] > 0.8 * solid.extents[1]
    }
    best = min(scores, key=lambda kind: scores[kind])
    odds: dict[Kind, float] = {kind: float(np.exp((scores[best] - score) / TEMPER)) for kind, score in scores.items()}
    total = sum(odds.values())
    likely: dict[Kind, float] = {kind: value / total for kind, value in odds.items()}
    return best, likely


def with_others(best: Kind, likely: Mapping[Kind, float], refined: Mapping[Kind, Refined]) -> Refined:
    """The best kind's solid, less sure by how far the others differ, each as much as it is likely.

        variance += sum over others k of p_k (value_k - value_best)^2

    Args:
        best: Kind that is taken.
        likely: How likely each kind is, 0..1.
        refined: Solids of all kinds.
    """
    chosen = refined[best]
    place, sizes = chosen.position_std**2, chosen.extents_std**2
    for kind, share in likely.items():
        if kind == best:
            continue
        other = refined[kind].solid
        place = place + share * (other.centre - chosen.solid.centre) ** 2
        quarters = round((other.yaw - chosen.solid.yaw) / (np.pi / 2)) if other.shape == "box" else 0
        extents = other.extents[[1, 0, 2]] if quarters % 2 else other.extents
        sizes = sizes + share * (extents - chosen.solid.extents) ** 2
    return replace(chosen, position_std=np.sqrt(place), extents_std=np.sqrt(sizes))


def _score(kind: Kind, solid: Solid, points: np.ndarray, depth_std: float) -> float:
    s = float(np.hypot(depth_std, FIT_STD))
    off = np.minimum(np.abs(surface_distance(kind, solid, points)), 3.0 * s)
    n = min(float(len(points)), PATCHES)
    return n * float(np.log(np.mean(off**2) + FIT_STD**2)) + FREEDOM[kind] * float(np.log(n))


def fit_lying_cylinder(points: np.ndarray, bottom: float) -> Solid:
    """Cylinder that lies on its side, as a box of its length and diameter whose x axis is the cylinder's.

    For every yaw in steps of two degrees, then of half a degree, points are projected along the axis. A circle that
    touches the support at height h has (y - c)^2 + (z - h)^2 = 2 r (z - h), so that with w = z - h

        y^2 + w^2 = 2 c y + 2 r w - c^2

    is linear in c, r and c^2. The yaw of the smallest scatter of the radii wins; points on the flat ends are trimmed.

    Args:
        points: In the world in [m], shape (n, 3).
        bottom: Height of the supporting surface in [m].
    """
    if len(points) > 1500:
        points = points[:: len(points) // 1500 + 1]
    middle = points.mean(0)
    local = points - [middle[0], middle[1], bottom]
    best, answer = np.inf, (0.0, 0.0, 0.02)
    for step, around in ((2.0, np.arange(0.0, 180.0, 2.0)), (0.5, np.arange(-2.0, 2.5, 0.5))):
        start = 0.0 if step == 2.0 else np.degrees(answer[0])
        for yaw in np.radians(start + around):
            across = -np.sin(yaw) * local[:, 0] + np.cos(yaw) * local[:, 1]
            centre, radius, off = _touching_circle(across, local[:, 2])
            scatter = float(np.mean(np.minimum(np.abs(off), 0.01)))
            if scatter < best:
                best, answer = scatter, (float(yaw), centre, radius)
    yaw, centre, radius = answer
    c, s = np.cos(yaw), np.sin(yaw)
    along = c * local[:, 0] + s * local[:, 1]
    # The top of the arc is seen along the whole length; the flat end adds points below it only.
    low, high = np.quantile(along, (0.01, 0.99))
    place = middle[:2] + np.array([c, s]) * (low + high) / 2 + np.array([-s, c]) * centre
    size = np.array([high - low, 2.0 * radius, 2.0 * radius])
    return Solid("box", np.array([*place, bottom + radius]), yaw, np.maximum(size, 0.004))


def _touching_circle(y: np.ndarray, w: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Centre c, radius r and distances to the circle about (c, r) that touches w = 0; trimmed twice."""
    chosen = np.ones(len(y), bool)
    centre, radius, off = 0.0, 0.02, np.zeros(len(y))
    for _ in range(3):
        design = np.stack([2.0 * y[chosen], 2.0 * w[chosen], -np.ones(int(chosen.sum()))], -1)
        found = np.linalg.lstsq(design, y[chosen] ** 2 + w[chosen] ** 2, rcond=None)[0]
        centre, radius = float(found[0]), float(np.clip(found[1], 0.005, 0.3))
        off = np.hypot(y - centre, w - radius) - radius
        chosen = np.abs(off) <= np.quantile(np.abs(off), 0.85)
    return centre, radius, off
