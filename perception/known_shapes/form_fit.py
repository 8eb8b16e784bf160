"""Pose and sizes of a thing whose form is known up to its sizes, from the points of all cameras together.

A piece of what depth shows beyond the support and the known furniture is taken for the thing if the form explains it.
Points p_i with rays d_i pull the form's surface, with signed distance f and normal n:

    sum_i rho(f(p_i)^2 / ((n · d_i)^2 s_i^2 + s_0^2)) + sum_k (log(size_k / usual size_k) / s_size)^2

because depth errs along the ray only. From several yaws this has several minima; the rays choose among them. A ray
that passes where the form would be speaks against it, and so does one that ends before it where nothing is: rays are
followed along the form's distance until they meet it, and cost what they cost in
`perception.known_shapes.articulated_fit`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from perception.estimates import Evidence, ObjectEstimate
from perception.frames import RgbdFrame
from perception.geometry.cloud import StereoNoise
from perception.geometry.solids import Solid
from perception.geometry.support import SupportPlane
from perception.known_shapes.articulated_fit import BEFORE, THROUGH
from perception.known_shapes.forms import FormSolid, KnownForm
from perception.known_shapes.rays import DepthRays
from perception.known_shapes.residual_clusters import ResidualCluster

STEP, SHARE = 1e-4, 1e-3  # for slopes: of a point in [m], of a size's logarithm
TOLERANCE = 0.025  # points end this far above what carries the thing at most, in [m]: its foot looks like the support


@dataclass(frozen=True)
class FormSettings:
    """Settings of the fit.

    Attributes:
        noise: Of the depth.
        yaws: How many yaws the fit is begun from.
        kept: How many of the minima the rays choose among.
        most_points: Points used by the fit.
        most_rays: Rays used to choose.
        model_std: What calibration, sampling and the form itself leave, in [m].
        size_std: Spread of a size as a share of the usual one.
        too_large: A piece larger than the usual sizes by this factor is something else, or more than one thing.
        least_share: Share of the rays that meet the form which must agree with it.
        least_explained: Share of the piece's points which must agree with it.
        least_rays: Fewest rays that must agree with it.
    """

    noise: StereoNoise = field(default_factory=StereoNoise)
    yaws: int = 8
    kept: int = 3
    most_points: int = 400
    most_rays: int = 1500
    model_std: float = 0.002
    size_std: float = 0.08
    too_large: float = 1.5
    least_share: float = 0.85
    least_explained: float = 0.85
    least_rays: int = 60


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
    x: np.ndarray
    bottom: float
    covariance: np.ndarray
    agreeing: float
    rays: np.ndarray

    @property
    def extents(self) -> np.ndarray:
        """Full sizes in [m], shape (3,)."""
        return self.form.extents * np.exp(self.x[3:])

    @property
    def pose(self) -> np.ndarray:
        """world_T_form, shape (4, 4)."""
        return _pose(self.form, self.x, self.bottom)

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
    best: tuple[float, _Problem, np.ndarray] | None = None
    for bottom in _bottoms(piece, points, table, others):
        problem = _Problem(rays.only(piece.which[:: max(1, len(piece.which) // s.most_points)]), form, bottom, s)
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


def _minima(problem: "_Problem", middle: np.ndarray, s: FormSettings) -> list[np.ndarray]:
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


def _distance(solids: Sequence[FormSolid], points: np.ndarray) -> np.ndarray:
    """Signed distance of points to the nearest of some solids in [m], shape (n,)."""
    nearest = solids[0].distance(points)
    for solid in solids[1:]:
        np.minimum(nearest, solid.distance(points), out=nearest)
    return nearest


def _pose(form: KnownForm, x: np.ndarray, bottom: float) -> np.ndarray:
    pose = np.eye(4)
    c, s = np.cos(x[2]), np.sin(x[2])
    pose[:2, :2] = [[c, -s], [s, c]]
    pose[:3, 3] = x[0], x[1], bottom + form.extents[2] * np.exp(x[5]) / 2
    return pose


class _Problem:
    """Points against hypotheses x = (x, y, yaw, log sizes) of one form that stands at a height."""

    def __init__(self, rays: DepthRays, form: KnownForm, bottom: float, settings: FormSettings) -> None:
        self.rays, self.form, self.bottom, self.settings = rays, form, bottom, settings
        self.points = rays.points

    def thinned(self, every: int) -> "_Problem":
        """The same with every n-th point."""
        return _Problem(self.rays.only(slice(None, None, every)), self.form, self.bottom, self.settings)

    def linear(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Signed distances of the points to the form's surface in [m], their slopes by x and spreads across it.

        With the local point q and the distance's gradient g there, a shift of the form by e changes it by -g · e, and
        a turn about z by g · (q_y, -q_x, 0).

        Returns:
            Shapes (n,), (n, 6) and (n,).
        """
        pose, sizes = _pose(self.form, x, self.bottom), self.form.extents * np.exp(x[3:])
        local = (self.points - pose[:3, 3]) @ pose[:3, :3]
        solids = self.form.build(sizes)
        off = _distance(solids, local)
        gradient = np.stack([(_distance(solids, local + STEP * e) - off) / STEP for e in np.eye(3)], -1)
        slopes = np.empty((len(off), 6))
        slopes[:, :2] = -gradient @ pose[:2, :3].T
        slopes[:, 2] = gradient[:, 0] * local[:, 1] - gradient[:, 1] * local[:, 0]
        for k in range(3):
            grown = sizes.copy()
            grown[k] *= np.exp(SHARE)
            # A taller one stands as low as before: its middle is higher.
            moved = local - [0.0, 0.0, (grown[2] - sizes[2]) / 2]
            slopes[:, 3 + k] = (_distance(self.form.build(grown), moved) - off) / SHARE
        # The distance grows along a ray by the cosine between the ray and the surface's normal.
        along = np.einsum("ij,ij->i", gradient, self.rays.direction @ pose[:3, :3])
        return off, slopes, np.hypot(self.rays.std * along, self.settings.model_std)

    def settle(self, x: np.ndarray, rounds: int = 25) -> tuple[float, np.ndarray]:
        """Damped Gauss-Newton from x with the weights 1 / (1 + (r / 2)^2); the cost reached and its x."""
        damping, best, at = 1e-2, np.inf, x
        kept = off, slopes, std = self.linear(x)
        for _ in range(rounds):
            cost = self._cost(off, std, x)
            if cost < best:
                best, at, damping = cost, x, max(damping / 4.0, 1e-5)
                kept = off, slopes, std
            else:
                damping *= 6.0
                off, slopes, std = kept
                if damping > 1e3:
                    break
            normal, gradient = self._normal(off, slopes, std, at)
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
            step = np.clip(step, [-0.02, -0.02, -0.3, -0.1, -0.1, -0.1], [0.02, 0.02, 0.3, 0.1, 0.1, 0.1])
            if np.all(np.abs(step) < [1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 1e-3]):
                break
            x = at + step
            x[3:] = np.clip(x[3:], -0.5, 0.5)
            off, slopes, std = self.linear(x)
        return best, at

    def _normal(self, off, slopes, std, x) -> tuple[np.ndarray, np.ndarray]:
        weight = self._shared() / (std**2 * (1.0 + (off / (2.0 * std)) ** 2))
        prior = np.array([0.0, 0.0, 0.0, *np.full(3, self.settings.size_std**-2.0)])
        normal = (slopes * weight[:, None]).T @ slopes + np.diag(prior + 1e-9)
        return normal, (slopes * weight[:, None]).T @ off + prior * x

    def _cost(self, off: np.ndarray, std: np.ndarray, x: np.ndarray) -> float:
        robust = 4.0 * np.log1p((off / (2.0 * std)) ** 2)
        return float(self._shared() * robust.sum() + np.sum((x[3:] / self.settings.size_std) ** 2))

    def _shared(self) -> float:
        """How many independent samples one point is, as neighbours share their error; points are thinned already."""
        return 0.3

    def covariance(self, x: np.ndarray) -> np.ndarray:
        """Of x, shape (6, 6)."""
        normal, _ = self._normal(*self.linear(x), x)
        return np.linalg.inv(normal)


def _followed(rays: DepthRays, form: KnownForm, x: np.ndarray, bottom: float, steps: int = 24) -> np.ndarray:
    """How far rays see until they meet the form in [m], infinite where they miss it, shape (n,): sphere tracing."""
    pose = _pose(form, x, bottom)
    sizes = form.extents * np.exp(x[3:])
    solids = form.build(sizes)
    origin = (rays.origin - pose[:3, 3]) @ pose[:3, :3]
    direction = rays.direction @ pose[:3, :3]
    # Only what passes the ball around it, from where it enters the ball on.
    middle = -np.einsum("ij,ij->i", origin, direction)
    across = np.einsum("ij,ij->i", origin, origin) - middle**2
    radius = 0.5 * float(np.linalg.norm(sizes)) + 0.01
    passing = np.flatnonzero((across < radius**2) & (middle > 0.0))
    found = np.full(len(rays), np.inf)
    if not len(passing):
        return found
    half = np.sqrt(radius**2 - across[passing])
    t, last = middle[passing] - half, middle[passing] + half
    origin, direction = origin[passing], direction[passing]
    active = np.arange(len(passing))
    met = np.zeros(len(passing), bool)
    for _ in range(steps):
        points = origin[active] + t[active, None] * direction[active]
        gap = _distance(solids, points)
        met[active[gap < 5e-4]] = True
        t[active] += np.maximum(gap, 0.0)
        active = active[(gap >= 5e-4) & (t[active] < last[active])]
        if not len(active):
            break
    found[passing[met]] = t[met]
    return found


def _ray_cost(
    rays: DepthRays, known: np.ndarray, form: KnownForm, x: np.ndarray, bottom: float, s: FormSettings
) -> float:
    seen = np.minimum(_followed(rays, form, x, bottom), known)
    off = np.clip((rays.distance - seen) / np.hypot(rays.std, s.model_std), -100.0, 100.0)
    return float(np.minimum(off**2, np.where(off > 0.0, THROUGH, BEFORE)).sum())


def _judged(
    rays: DepthRays,
    known: np.ndarray,
    near: np.ndarray,
    piece: ResidualCluster,
    problem: _Problem,
    x: np.ndarray,
    s: FormSettings,
) -> FormFit | str:
    """The fit at x with its spreads, or why it is not believed."""
    form = problem.form
    close = rays.only(near)
    seen = _followed(close, form, x, problem.bottom)
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


def form_estimate(
    fit: FormFit, name: str, rays: DepthRays, frames: Sequence[RgbdFrame], stride: int, model_std: float
) -> ObjectEstimate:
    """A fit as an estimate, with the pixels that agree with it as evidence.

    Args:
        fit: The fit.
        name: Scene name.
        rays: That it was fitted to.
        frames: Their pictures.
        stride: Every how many rows and columns there is a ray.
        model_std: Least spread in [m].
    """
    evidence = []
    for i, frame in enumerate(frames):
        own = rays.pixel[fit.rays[rays.frame[fit.rays] == i]]
        if len(own) < 5:
            continue
        mask = np.zeros(frame.depth.shape, np.uint8)
        mask[tuple(own.T)] = 1
        mask = cv2.dilate(mask, np.ones((stride + 1, stride + 1), np.uint8)) > 0
        v, u = np.nonzero(mask)
        box = np.array([u.min(), v.min(), u.max() + 1, v.max() + 1], float)
        evidence.append(Evidence(frame.camera, box, mask, float(frame.valid_depth[mask].mean()), "known form"))
    sizes = np.hypot(np.sqrt(np.diag(fit.covariance)[3:]) * fit.extents, model_std)
    level = np.hypot(np.sqrt(np.diag(fit.covariance)[:2]), model_std)
    tall = float(np.hypot(0.0015, sizes[2] / 2))
    return ObjectEstimate(
        name=name,
        phrase=name.replace("_", " "),
        world_T_object=fit.pose,
        extents=fit.extents,
        shape="box",
        position_std=np.array([*level, tall]),
        yaw_std=float(np.hypot(np.sqrt(fit.covariance[2, 2]), 0.003)),
        score=float(np.clip(fit.agreeing, 0.0, 1.0)),
        stamp=max(frame.stamp for frame in frames),
        evidence=tuple(evidence),
        extents_std=sizes,
    )
