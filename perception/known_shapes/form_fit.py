"""Pose and sizes of a thing whose form is known up to its sizes, from the points of all cameras together.

A piece of what depth shows beyond the support and the known furniture is taken for the thing if the form explains it.
From several yaws the fit to its points (`perception.known_shapes.form_hypotheses`) has several minima; the rays choose
among them. A ray that passes where the form would be speaks against it, and so does one that ends before it where
nothing is (`perception.known_shapes.ray_costs`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.geometry.depth_rays import DepthRays
from perception.geometry.solids import Solid
from perception.geometry.support import SupportPlane
from perception.known_shapes.fit_settings import FormSettings
from perception.known_shapes.form_hypotheses import FormProblem, followed, form_pose
from perception.known_shapes.forms import KnownForm
from perception.known_shapes.ray_costs import ray_costs
from perception.known_shapes.residual_clusters import ResidualCluster

TOLERANCE = 0.025  # points end this far above what carries the thing at most, in [m]: its foot looks like the support


@dataclass(frozen=True)
class FormFit:
    """A form found.

    Attributes:
        form: What was found.
        x: Place (x, y) in [m], yaw in [rad] and logarithms of the sizes over the usual ones, shape (6,).
        bottom: Height of what it stands on in [m].
        covariance: Of x, shape (6, 6).
        agreeing: Share of the rays that meet it, and that nothing before it hides, which agree with it, 0..1.
        rays: Indices of those that agree.
    """

    form: KnownForm
    x: NDArray[np.float64]
    bottom: float
    covariance: NDArray[np.float64]
    agreeing: float
    rays: NDArray[np.int64]

    @property
    def extents(self) -> np.ndarray:
        """Full sizes in [m], shape (3,)."""
        return self.form.extents * np.exp(self.x[3:])

    @property
    def pose(self) -> np.ndarray:
        """world_T_form, shape (4, 4)."""
        return form_pose(self.form, self.x, self.bottom)

    @property
    def solid(self) -> Solid:
        """Its box in the world."""
        return Solid("box", self.pose[:3, 3], float(self.x[2]), self.extents)


def fit_form(
    rays: DepthRays,
    known: np.ndarray,
    piece: ResidualCluster,
    form: KnownForm,
    table: SupportPlane,
    others: Sequence[Solid],
    settings: FormSettings | None = None,
) -> FormFit | str:
    """Fit a form to a piece.

    Args:
        rays: Of pictures of one moment.
        known: How far they see until they meet the support or known furniture in [m], shape (n,).
        piece: Some of their points.
        form: What it may be.
        table: What things stand on.
        others: Solids on whose tops it may stand.
        settings: Of the fit.

    Returns:
        The fit, or why the piece is not that.
    """
    s = settings or FormSettings()
    points = rays.points[piece.which]
    size = piece.high - piece.low
    usual = form.extents
    if size[2] > s.too_large * usual[2] or np.hypot(*size[:2]) > s.too_large * np.hypot(*usual[:2]):
        return f"what stands there is {size[0]:.2f} x {size[1]:.2f} x {size[2]:.2f} m: too large for a {form.noun}"
    if size[2] < 0.4 * usual[2]:
        return f"what stands there is only {size[2]:.2f} m high: too low for a {form.noun}"
    middle = np.array([*(piece.low[:2] + piece.high[:2]) / 2, piece.low[2] + usual[2] / 2])
    near = np.flatnonzero(rays.near(middle, 0.6 * float(np.linalg.norm(usual)) + 0.02))
    few = near[:: max(1, len(near) // s.most_rays)]
    best: tuple[float, FormProblem, np.ndarray] | None = None
    for bottom in _bottoms(piece, points, table, others):
        problem = FormProblem(rays.only(piece.which[:: max(1, len(piece.which) // s.most_points)]), form, bottom, s)
        for x in _minima(problem, middle, s):
            cost = _ray_cost(rays.only(few), known[few], form, x, bottom, s)
            if best is None or cost < best[0]:
                best = cost, problem, x
    assert best is not None
    return _judged(rays, known, near, piece, *best[1:], s)


def _bottoms(piece: ResidualCluster, points: np.ndarray, table: SupportPlane, others: Sequence[Solid]) -> list[float]:
    """Heights in [m] that the thing may stand at: on the surface below it, or, should it hang, where it ends."""
    x, y = np.median(points[:, 0]), np.median(points[:, 1])
    lowest = float(piece.low[2])
    surfaces = [float(table.at(x, y)), *(s.top for s in others if s.shape != "sphere" and s.covers(x, y, 0.01))]
    carrier = max((s for s in surfaces if s <= lowest + TOLERANCE), default=min(surfaces))
    return [carrier, lowest] if lowest > carrier + TOLERANCE else [carrier]


def _minima(problem: FormProblem, middle: np.ndarray, s: FormSettings) -> list[np.ndarray]:
    """The best minima, begun from all yaws with few of the points, and ended with all of them."""
    few = problem.thinned(4)
    rough = []
    for yaw in np.arange(s.yaws) * 2.0 * np.pi / s.yaws:
        rough.append(few.settle(np.array([*middle[:2], yaw, 0.0, 0.0, 0.0]), 8))
    starts = _apart([x for _, x in sorted(rough, key=lambda m: m[0])])
    return [problem.settle(x)[1] for x in starts[: s.kept]]


def _apart(minima: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Minima without those that are another one's, in their order."""
    found: list[np.ndarray] = []
    for x in minima:
        if all(np.hypot(*(x[:2] - y[:2])) > 0.012 or abs(np.sin((x[2] - y[2]) / 2)) > 0.1 for y in found):
            found.append(x)
    return found


def _ray_cost(
    rays: DepthRays, known: np.ndarray, form: KnownForm, x: np.ndarray, bottom: float, s: FormSettings
) -> float:
    seen = np.minimum(followed(rays, form, x, bottom), known)
    return float(ray_costs(rays.distance, seen, np.hypot(rays.std, s.model_std)).sum())


def _judged(
    rays: DepthRays,
    known: np.ndarray,
    near: np.ndarray,
    piece: ResidualCluster,
    problem: FormProblem,
    x: np.ndarray,
    s: FormSettings,
) -> FormFit | str:
    """The fit at x with its spreads, or why it is not believed."""
    form = problem.form
    close = rays.only(near)
    seen = followed(close, form, x, problem.bottom)
    off = (close.distance - seen) / np.hypot(close.std, s.model_std)
    met = np.isfinite(seen) & (seen < known[near])
    agree = met & (np.abs(off) < 3.0)
    before = met & (off <= -3.0)
    share = float(agree.sum() / max(1, (met & ~before).sum()))
    distance, _, std = problem.linear(x)
    explained = float(np.mean(np.abs(distance) < 3.0 * std + s.model_std))
    if agree.sum() < s.least_rays or share < s.least_share or explained < s.least_explained:
        return (
            f"what stands there is no {form.noun}: the likeliest pose explains {explained:.0%} of its points and "
            f"agrees with {share:.0%} of the {int((met & ~before).sum())} depth samples that would see it "
            f"({s.least_explained:.0%}, {s.least_share:.0%} and {s.least_rays} are needed)"
        )
    return FormFit(form, x, problem.bottom, problem.covariance(x), share, near[agree])
