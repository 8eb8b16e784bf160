"""Pose of a thing of known shape, and how far each of its joints is open.

Every ray of the depth pictures is compared with how far it would see if the model stood there. With the measured
distance r, the predicted one m (model or background) and their spread s, a ray costs

    min((r - m)^2 / s^2, 16)  where it sees through the model or the background (r > m)
    min((r - m)^2 / s^2,  9)  where something stands before it (r < m): an arm, a thing that nobody named

and a hypothesis is worth what it saves against the background alone (the support and what was found before). So a
door cannot hang in air that a camera looked through, and what hides the model costs nothing. The best places of a
coarse search (`perception.known_shapes.pose_search`) are refined with projective point-to-plane steps over (x, y, yaw,
fractions); J^T J at the end gives the spreads.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from perception.frames import RgbdFrame
from perception.geometry.cloud import StereoNoise
from perception.geometry.solids import Solid
from perception.geometry.support import SupportPlane
from perception.known_shapes.models import KnownModel
from perception.known_shapes.pose_search import SearchSettings, places
from perception.known_shapes.rays import DepthRays, cast, depth_rays

THROUGH, BEFORE = 16.0, 9.0  # highest costs of a ray


@dataclass(frozen=True)
class KnownSettings:
    """Settings of the fit.

    Attributes:
        noise: Of the depth.
        search: The coarse search.
        stride: Every n-th row and column of the pictures is used.
        sparse, dense: Of these every n-th ray is used while hypotheses are many, and while they are few.
        refined: How many places are refined.
        fractions: How many fractions of each joint are tried.
        model_std: What a cell file's sizes, sampling and calibration leave, in [m].
        edges_from: Spread in [m] beyond which faces do not tell the place and edges are asked.
        least_share: Share of the rays that meet the model which must agree with it.
        least_rays: Fewest rays that must agree with it.
        still, still_yaw: What moved by no more than this since an earlier look, in [m] and [rad], stands there still.
        position_prior, yaw_prior, fraction_prior: Spread of what nothing is seen of, in [m], [rad] and 1.
    """

    noise: StereoNoise = field(default_factory=StereoNoise)
    search: SearchSettings = field(default_factory=SearchSettings)
    stride: int = 4
    sparse: int = 16
    dense: int = 4
    refined: int = 8
    fractions: int = 21
    model_std: float = 0.002
    edges_from: float = 0.003
    least_share: float = 0.9
    least_rays: int = 60
    still: float = 0.015
    still_yaw: float = 0.1
    position_prior: float = 0.05
    yaw_prior: float = 0.2
    fraction_prior: float = 0.5


@dataclass(frozen=True)
class KnownFit:
    """A model found.

    Attributes:
        model: What was found.
        x: Place (x, y) in [m], yaw in [rad] and fractions (0 closed .. 1 open, one a part), shape (3 + parts,).
        world_T_model: Its pose, shape (4, 4).
        position_std: Along the world's axes in [m], shape (3,).
        yaw_std: In [rad].
        fraction_std: One a part, shape (len(parts),); large for a part that no camera saw.
        agreeing: Share of the rays that meet it, and that nothing before it hides, which agree with it, 0..1.
        pixels: Rows and columns of the pixels that agree, one array of shape (m, 2) a picture.
        stride: Every how many rows and columns one was looked at.
    """

    model: KnownModel
    x: np.ndarray
    world_T_model: np.ndarray
    position_std: np.ndarray
    yaw_std: float
    fraction_std: np.ndarray
    agreeing: float
    pixels: tuple[np.ndarray, ...]
    stride: int

    @property
    def fractions(self) -> np.ndarray:
        """0 closed .. 1 open, one a part, shape (len(parts),)."""
        return self.x[3:]

    def masks(self, frames: Sequence[RgbdFrame]) -> list[np.ndarray]:
        """Pixels that agree, with those around them that were not looked at; one bool (height, width) a picture."""
        masks = []
        for i, frame in enumerate(frames):
            seen = np.zeros(frame.depth.shape, np.uint8)
            if i < len(self.pixels):
                seen[tuple(self.pixels[i].T)] = 1
            masks.append(cv2.dilate(seen, np.ones((self.stride + 1, self.stride + 1), np.uint8)) > 0)
        return masks

    @property
    def solid(self) -> Solid:
        """Its box in the world."""
        return Solid("box", self.world_T_model[:3, 3], float(self.x[2]), self.model.extents)


def fit_known(
    frames: Sequence[RgbdFrame],
    models: Sequence[KnownModel],
    table: SupportPlane,
    settings: KnownSettings | None = None,
    before: Mapping[str, np.ndarray] | None = None,
) -> dict[str, KnownFit | str]:
    """Find things of known shape in pictures of one moment, taken by one or several cameras.

    The largest is looked for first; what it explains belongs to the background of the smaller ones. What was seen
    before is looked for there first, with its parts wherever they are now, and everywhere only if it is not there.

    Args:
        frames: At least one.
        models: What stands there somewhere, each once at most.
        table: What they stand on.
        settings: Of the fit.
        before: Where some of them stood at an earlier look, by name: x as in `KnownFit`, shape (3 + parts,).

    Returns:
        By name the fit, or the reason why there is none.
    """
    s = settings or KnownSettings()
    rays = depth_rays(frames, s.noise, s.stride)
    background = distance_to_support(table, rays)
    found: dict[str, KnownFit | str] = {}
    taken: list[Solid] = []
    for model in sorted(models, key=lambda m: -float(np.prod(m.extents))):
        fit = _fit_at(rays, background, table, model, (before or {}).get(model.name), s)
        if fit is None:
            starts = places(frames, rays, model, table.height, taken, s.noise, s.search)
            if not starts:
                found[model.name] = "nothing stands on the support that could be it"
                continue
            fit = _fit_one(rays, background, table, model, starts, s)
        found[model.name] = fit
        if isinstance(fit, KnownFit):
            seen = _Scene(rays, background, table, model, s).predict(fit.x)
            background = np.minimum(background, seen.distance)
            taken.append(fit.solid)
    return found


def _fit_one(
    rays: DepthRays,
    background: np.ndarray,
    table: SupportPlane,
    model: KnownModel,
    starts: Sequence[np.ndarray],
    s: KnownSettings,
) -> KnownFit | str:
    """Refine the best of many starts, first with few rays, then with all of them."""
    few = slice(None, None, s.sparse)
    sparse = _Scene(rays.only(few), background[few], table, model, s)
    # A start is wrong by half a step of the search, which must not count yet.
    blurred = _Scene(sparse.rays, background[few], table, model, replace(s, model_std=s.search.cell))
    tried = sorted(starts, key=blurred.worth)[: s.refined]
    tried = [sparse.settle(sparse.opened(sparse.settle(x, 4)), 4) for x in tried]
    best = sorted(tried, key=sparse.worth)[:2]
    # Front and back of a closed cabinet differ by a handle and a plinth only, and a lever's post is square.
    turned = [sparse.settle(sparse.opened(x), 8, keep=False) for x in _turned(model, best[0])]
    turned = sorted(turned, key=sparse.worth)[:2]
    best.append(min((sparse.settle(sparse.opened(x), 4) for x in turned), key=sparse.worth))
    some = slice(None, None, s.dense)
    scene = _Scene(rays.only(some), background[some], table, model, s)
    best = min((scene.settle(scene.opened(x), 5) for x in best), key=scene.worth)
    whole = _Scene(rays, background, table, model, s)
    best = whole.settle(scene.opened(best, fine=True), 5)
    return whole.judged(whole.shifted(best))


def _fit_at(
    rays: DepthRays,
    background: np.ndarray,
    table: SupportPlane,
    model: KnownModel,
    x: np.ndarray | None,
    s: KnownSettings,
) -> KnownFit | None:
    """The model where it stood before, if it is still there."""
    if x is None:
        return None
    fit = _fit_one(rays, background, table, model, [x], s)
    if (
        isinstance(fit, str)
        or np.hypot(*(fit.x[:2] - x[:2])) > s.still
        or np.cos(fit.x[2] - x[2]) < np.cos(s.still_yaw)
    ):
        return None
    return fit


def _turned(model: KnownModel, x: np.ndarray) -> list[np.ndarray]:
    """The other three headings of a place with every part closed, about the middle of its box and of what stands fixed.

    A lever's post stands at the back of its box: seen from behind it seems to be a lever's that looks the other way.
    """
    volume = np.array([np.prod(b.high - b.low) for b in model.boxes])
    centre = np.array([(b.low[:2] + b.high[:2]) / 2 for b in model.boxes])
    pivots = [volume @ centre / volume.sum()]
    if np.linalg.norm(pivots[0]) > 0.005:
        pivots.append(np.zeros(2))

    def about(yaw: float) -> np.ndarray:
        return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])

    closed = np.zeros(len(model.parts))
    yaws = x[2] + np.pi / 2 * np.arange(1, 4)
    return [np.array([*(x[:2] + (about(x[2]) - about(yaw)) @ p), yaw, *closed]) for yaw in yaws for p in pivots]


@dataclass(frozen=True)
class _Prediction:
    """How far rays would see, and what they would see.

    Attributes:
        distance: To the model in [m], infinite where it is not met, shape (n,).
        group: 0 for its fixed boards, i + 1 for its i-th part; shape (n,).
        normal: Of the face met in the world, shape (n, 3).
    """

    distance: np.ndarray
    group: np.ndarray
    normal: np.ndarray


class _Scene:
    """Rays against hypotheses x = (x, y, yaw, fractions) of one model."""

    def __init__(
        self,
        rays: DepthRays,
        background: np.ndarray,
        table: SupportPlane,
        model: KnownModel,
        settings: KnownSettings,
    ) -> None:
        self.rays, self.background, self.table, self.model, self.settings = rays, background, table, model, settings
        self.std = np.hypot(rays.std, settings.model_std)
        self.empty = self._cost(background)

    def pose(self, x: np.ndarray) -> np.ndarray:
        """world_T_model, shape (4, 4)."""
        return self.model.standing(x[0], x[1], x[2], float(self.table.at(x[0], x[1])))

    def _cost(self, predicted: np.ndarray, which: np.ndarray | slice = slice(None)) -> np.ndarray:
        off = np.clip((self.rays.distance[which] - predicted) / self.std[which], -100.0, 100.0)
        return np.minimum(off**2, np.where(off > 0.0, THROUGH, BEFORE))

    def _part_of(self, x: np.ndarray) -> "_Scene":
        """The same with those rays only that can meet the model at x, wherever its parts are."""
        near = self.rays.near(self.pose(x)[:3, 3], self.model.reach + 0.05)
        part = object.__new__(_Scene)
        part.table, part.model, part.settings = self.table, self.model, self.settings
        part.rays, part.std = self.rays.only(near), self.std[near]
        part.background, part.empty = self.background[near], self.empty[near]
        return part

    def predict(self, x: np.ndarray, only: int | None = None) -> _Prediction:
        """What the rays would meet of the model; of one group only if asked."""
        pose = self.pose(x)
        n = len(self.rays)
        distance, group = np.full(n, np.inf), np.zeros(n, int)
        normal = np.zeros((n, 3))
        for i, (frame, boxes) in enumerate(self.model.groups(x[3:])):
            if only is not None and i != only:
                continue
            world_T_frame = pose @ frame
            hits = cast(self.rays, world_T_frame, boxes)
            closer = hits.distance < distance
            distance[closer], group[closer] = hits.distance[closer], i
            normal[closer] = hits.normal[closer] @ world_T_frame[:3, :3].T
        return _Prediction(distance, group, normal)

    def worth(self, x: np.ndarray) -> float:
        """What the hypothesis saves against an empty support; the lower the better."""
        near = self._part_of(x)
        return near._saved(near.predict(x).distance)

    def _saved(self, distance: np.ndarray) -> float:
        return float((self._cost(np.minimum(distance, self.background)) - self.empty).sum())

    def opened(self, x: np.ndarray, fine: bool = False) -> np.ndarray:
        """The same place with each joint at its best fraction, one joint after the other, twice.

        Args:
            x: The hypothesis.
            fine: Look only near the fractions of x, in small steps, and at a few far from it.
        """
        near = self._part_of(x)
        x = x.copy()
        n = self.settings.fractions
        for sweep in range(2 if len(self.model.parts) > 1 else 1):
            for i in range(len(self.model.parts)):
                rest = np.full(len(near.rays), np.inf)
                for group in range(len(self.model.parts) + 1):
                    # In the first sweep the parts not yet looked at are left out: they are not known to be anywhere.
                    if group != i + 1 and (sweep or fine or group <= i):
                        rest = np.minimum(rest, near.predict(x, group).distance)
                tried = np.linspace(0.0, 1.0, n)
                if fine:
                    tried = np.r_[tried, np.clip(x[3 + i] + np.linspace(-1.0, 1.0, n) / n, 0.0, 1.0)]
                costs = []
                for fraction in tried:
                    x[3 + i] = fraction
                    costs.append(near._saved(np.minimum(rest, near.predict(x, i + 1).distance)))
                x[3 + i] = tried[int(np.argmin(costs))]
        return x

    def settle(self, x: np.ndarray, rounds: int, keep: bool = True) -> np.ndarray:
        """Damped point-to-plane steps from x; the better of both ends, or the last one if not `keep`."""
        near = self._part_of(x)
        first, gate = x.copy(), 0.05
        for _ in range(rounds):
            jacobian, off, weight = near._linear(x, gate)
            normal = (jacobian * weight[:, None]).T @ jacobian + np.diag(self._prior())
            step = _bounded_step(normal, (jacobian * weight[:, None]).T @ off, x)
            step = np.clip(step, -self._longest(), self._longest())
            x = x + step
            x[3:] = np.clip(x[3:], 0.0, 1.0)
            gate = max(0.6 * gate, 0.012)
            if np.all(np.abs(step) < 1e-4):
                break
        return x if not keep or near.worth(x) <= near.worth(first) else first

    def shifted(self, x: np.ndarray) -> np.ndarray:
        """Shift and turn x by what rays past its edges say, if its faces do not tell where it is.

        Faces hold a flat thing along their normals only; that rays end on it or pass it holds the rest.
        """
        near = self._part_of(x)
        if near._covariance(x)[[0, 1], [0, 1]].max() < self.settings.edges_from**2:
            return x
        best, size = near.worth(x), np.array([0.012, 0.012, 0.1])
        while size[0] > 0.001:
            better = False
            for way in np.vstack([np.diag(size), -np.diag(size)]):
                tried = x + np.array([*way, *np.zeros(len(self.model.parts))])
                worth = near.worth(tried)
                if worth < best:
                    x, best, better = tried, worth, True
            if not better:
                size = size / 2.0
        return x

    def _covariance(self, x: np.ndarray) -> np.ndarray:
        """Of x, as far as the faces that are seen tell it, shape (len(x), len(x))."""
        jacobian, _, weight = self._linear(x, 0.012)
        return np.linalg.inv((jacobian * weight[:, None]).T @ jacobian + np.diag(self._prior()))

    def _longest(self) -> np.ndarray:
        return np.array([0.03, 0.03, 0.12, *np.full(len(self.model.parts), 0.1)])

    def _prior(self) -> np.ndarray:
        s = self.settings
        std = np.array([s.position_prior, s.position_prior, s.yaw_prior])
        return np.array([*std, *np.full(len(self.model.parts), s.fraction_prior)]) ** -2.0

    def _linear(self, x: np.ndarray, gate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Point-to-plane residuals linearised at x.

        With p measured, q and n point and normal of the face that its ray meets, off = n · (p - q) = J dx, where a
        point of the model moves along x and y by dx, about the frame's z by yaw, and with its part.

        Returns:
            J of shape (m, len(x)), off in [m] and weights of shape (m,).
        """
        seen = self.predict(x)
        # Parallel to the face, an error along the ray moves a point within it.
        along = np.abs(np.einsum("ij,ij->i", seen.normal, self.rays.direction))
        off_ray = self.rays.distance - seen.distance
        used = (np.abs(off_ray) < gate + 3.0 * self.std) & (along > 0.1)
        used &= seen.distance < self.background
        normal, points = seen.normal[used], self.rays.points[used]
        distance = seen.distance[used]
        q = self.rays.origin[used] + distance[:, None] * self.rays.direction[used]
        off = np.einsum("ij,ij->i", normal, points - q)
        pose = self.pose(x)
        arm = q - pose[:3, 3]
        columns = [normal[:, 0], normal[:, 1], normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]]
        for i, part in enumerate(self.model.parts):
            axis = pose[:3, :3] @ part.axis
            if part.kind == "slide":
                way = np.broadcast_to(axis, q.shape)
            else:
                way = np.cross(axis, q - (pose[:3, :3] @ part.anchor + pose[:3, 3]))
            columns.append(part.opened * np.einsum("ij,ij->i", normal, way) * (seen.group[used] == i + 1))
        std = np.hypot(self.rays.std[used] * along[used], self.settings.model_std)
        # Neighbouring rays share their error: one patch counts once.
        shared = min(1.0, self._spacing() ** 2 / self.settings.noise.patch_px)
        weight = shared / (std**2 * (1.0 + (off / (2.0 * std)) ** 2))
        return np.stack(columns, -1), off, weight

    def _spacing(self) -> float:
        return float(self.settings.stride)

    def judged(self, x: np.ndarray) -> KnownFit | str:
        """The fit at x with its spreads, or why it is not believed."""
        s = self.settings
        seen = self.predict(x)
        off = (self.rays.distance - seen.distance) / self.std
        met = np.isfinite(seen.distance) & (seen.distance < self.background)
        agree = met & (np.abs(off) < 3.0)
        before = met & (off <= -3.0)
        count, shown = int(agree.sum()), int((met & ~before).sum())
        share = count / max(shown, 1)
        if count < s.least_rays or share < s.least_share:
            return (
                f"nothing in view has its shape (the likeliest place agrees with {count} depth samples, "
                f"{share:.0%} of those that would see it; {s.least_rays} and {s.least_share:.0%} are needed)"
            )
        spread = np.sqrt(np.diag(self._covariance(x)))
        flat = np.sqrt(spread[:2] ** 2 + s.model_std**2)
        fraction_std = np.array(
            [np.hypot(spread[3 + i], 0.01 if p.kind == "hinge" else s.model_std / p.opened)
             for i, p in enumerate(self.model.parts)]
        )  # fmt: skip
        cameras = range(int(self.rays.frame.max()) + 1)
        pixels = tuple(self.rays.pixel[agree & (self.rays.frame == i)] for i in cameras)
        return KnownFit(
            self.model, x, self.pose(x), np.array([*flat, 2.0 * s.model_std]), float(np.hypot(spread[2], 0.003)),
            fraction_std, share, pixels, s.stride,
        )  # fmt: skip


def distance_to_support(table: SupportPlane, rays: DepthRays) -> np.ndarray:
    """How far the rays see until they meet the support, in [m], infinite where they do not; shape (n,)."""
    a, b = table.slope
    rise = rays.direction[:, 2] - a * rays.direction[:, 0] - b * rays.direction[:, 1]
    height = rays.origin[:, 2] - table.height - a * rays.origin[:, 0] - b * rays.origin[:, 1]
    return np.where(rise < -1e-6, height / np.maximum(-rise, 1e-6), np.inf)


def _bounded_step(normal: np.ndarray, gradient: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Solution of normal · step = gradient; what leaves the fractions' range 0..1 stops there and the rest adapts."""
    step = np.linalg.solve(normal, gradient)
    stopped = np.zeros(len(x), bool)
    for _ in range(len(x) - 3):
        beyond = ~stopped & (np.arange(len(x)) >= 3) & ((x + step < 0.0) | (x + step > 1.0))
        if not beyond.any():
            break
        step[beyond] = np.clip(x[beyond] + step[beyond], 0.0, 1.0) - x[beyond]
        stopped |= beyond
        free = ~stopped
        step[free] = np.linalg.solve(
            normal[np.ix_(free, free)], gradient[free] - normal[np.ix_(free, stopped)] @ step[stopped]
        )
    return step
