"""Pose of a thing of known shape, and how far each of its joints is open.

Every ray of the depth pictures is compared with how far it would see if the model stood there
(`perception.known_shapes.ray_scene`). The best places of a coarse search (`perception.known_shapes.pose_search`) are
refined with projective point-to-plane steps over (x, y, yaw, fractions); J^T J at the end gives the spreads.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from perception.geometry.depth_rays import joined
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.solids import Solid
from perception.geometry.support import SupportPlane
from perception.known_shapes.fit_settings import KnownSettings
from perception.known_shapes.models import KnownModel
from perception.known_shapes.pose_search import places
from perception.known_shapes.ray_costs import distance_to_support
from perception.known_shapes.ray_scene import RayScene


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
    x: NDArray[np.float64]
    world_T_model: NDArray[np.float64]
    position_std: NDArray[np.float64]
    yaw_std: float
    fraction_std: NDArray[np.float64]
    agreeing: float
    pixels: tuple[np.ndarray, ...]
    stride: int

    @property
    def fractions(self) -> np.ndarray:
        """0 closed .. 1 open, one a part, shape (len(parts),)."""
        return self.x[3:]

    @property
    def solid(self) -> Solid:
        """Its box in the world."""
        return Solid("box", self.world_T_model[:3, 3], float(self.x[2]), self.model.extents)


def fit_known(
    frames: Sequence[PreparedFrame],
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
    rays = joined([frame.rays(s.stride) for frame in frames])
    # Neighbouring rays share their error: one patch counts once.
    shared = min(1.0, float(s.stride) ** 2 / frames[0].noise.patch_px)
    background = distance_to_support(table, rays)
    found: dict[str, KnownFit | str] = {}
    taken: list[Solid] = []
    for model in sorted(models, key=lambda m: -float(np.prod(m.extents))):
        scene = RayScene(rays, background, table, model, s, shared)
        fit = _fit_at(scene, (before or {}).get(model.name))
        if fit is None:
            starts = places(frames, rays, model, table.height, taken, s.search)
            if not starts:
                found[model.name] = "nothing stands on the support that could be it"
                continue
            fit = _fit_one(scene, starts)
        found[model.name] = fit
        if isinstance(fit, KnownFit):
            background = np.minimum(background, scene.predict(fit.x).distance)
            taken.append(fit.solid)
    return found


def _fit_one(whole: RayScene, starts: Sequence[np.ndarray]) -> KnownFit | str:
    """Refine the best of many starts, first with few rays, then with all of them."""
    s, model = whole.settings, whole.model
    sparse = whole.thinned(s.sparse)
    # A start is wrong by half a step of the search, which must not count yet.
    blurred = sparse.with_settings(replace(s, model_std=s.search.cell))
    tried = sorted(starts, key=blurred.worth)[: s.refined]
    tried = [sparse.settle(sparse.opened(sparse.settle(x, 4)), 4) for x in tried]
    best = sorted(tried, key=sparse.worth)[:2]
    # Front and back of a closed cabinet differ by a handle and a plinth only, and a lever's post is square.
    turned = [sparse.settle(sparse.opened(x), 8, keep=False) for x in _turned(model, best[0])]
    turned = sorted(turned, key=sparse.worth)[:2]
    best.append(min((sparse.settle(sparse.opened(x), 4) for x in turned), key=sparse.worth))
    scene = whole.thinned(s.dense)
    best = min((scene.settle(scene.opened(x), 5) for x in best), key=scene.worth)
    best = whole.settle(scene.opened(best, fine=True), 5)
    return _judged(whole, whole.shifted(best))


def _fit_at(scene: RayScene, x: np.ndarray | None) -> KnownFit | None:
    """The model where it stood before, if it is still there."""
    if x is None:
        return None
    fit, s = _fit_one(scene, [x]), scene.settings
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


def _judged(scene: RayScene, x: np.ndarray) -> KnownFit | str:
    """The fit at x with its spreads, or why it is not believed."""
    s = scene.settings
    seen = scene.predict(x)
    off = (scene.rays.distance - seen.distance) / scene.std
    met = np.isfinite(seen.distance) & (seen.distance < scene.background)
    agree = met & (np.abs(off) < 3.0)
    before = met & (off <= -3.0)
    count, shown = int(agree.sum()), int((met & ~before).sum())
    share = count / max(shown, 1)
    if count < s.least_rays or share < s.least_share:
        return (
            f"nothing in view has its shape (the likeliest place agrees with {count} depth samples, "
            f"{share:.0%} of those that would see it; {s.least_rays} and {s.least_share:.0%} are needed)"
        )
    spread = np.sqrt(np.diag(scene.covariance(x)))
    flat = np.sqrt(spread[:2] ** 2 + s.model_std**2)
    fraction_std = np.array(
        [np.hypot(spread[3 + i], 0.01 if p.kind == "hinge" else s.model_std / p.opened)
         for i, p in enumerate(scene.model.parts)]
    )  # fmt: skip
    cameras = range(int(scene.rays.frame.max()) + 1)
    pixels = tuple(scene.rays.pixel[agree & (scene.rays.frame == i)] for i in cameras)
    return KnownFit(
        scene.model, x, scene.pose(x), np.array([*flat, 2.0 * s.model_std]), float(np.hypot(spread[2], 0.003)),
        fraction_std, share, pixels, s.stride,
    )  # fmt: skip
