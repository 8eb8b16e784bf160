"""A solid's parameters from its outline and its points, whatever the solid.

Outline pixels are sharp across the ray and depth is noisy along it, so the outline fixes place, size and turn across
the ray and the mean of many depths fixes the distance. Minimised over the parameters x by Gauss-Newton with damping:

    sum_i (w_i r_i(x))^2,   r = outline distances [px], point-to-surface distances [m], and soft priors

with robust weights 1 / sqrt(1 + (r/s)^2) on outline and points. The inverse of J^T J at the end is the covariance
of x, which says by itself how little a half-hidden thing tells.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.frames import RgbdFrame
from perception.geometry.solid_outlines import outline_distance, project

OUTLINE_STD_PX = 1.0  # how well a mask's edge is known
UNKNOWN_STD_PX = 3.0  # the same where nothing is known beyond it, so that colour alone says that it ends there


@dataclass(frozen=True)
class Observation:
    """What a refinement has to match.

    Attributes:
        frame: The picture.
        outline: The thing's own outline in [px], shape (m, 2); empty when all of it is hidden.
        outline_std: How well each of its points is known in [px], shape (m,).
        points: Trusted points in the world in [m], shape (n, 3).
        point_std: Spread of one point along its ray in [m].
        patches: Number of points that err independently of each other.
        top: Height of the upper surface in [m], as the points say.
        bottom: Height of the supporting surface in [m].
        bottom_std: Its spread in [m].
        equal_sides: Whether the thing is known to be as long as wide as high.
    """

    frame: RgbdFrame
    outline: NDArray[np.float64]
    outline_std: NDArray[np.float64]
    points: NDArray[np.float64]
    point_std: float
    patches: float
    top: float
    bottom: float
    bottom_std: float
    equal_sides: bool = False


def observe(
    frame: RgbdFrame,
    outline: np.ndarray,
    outline_std: np.ndarray,
    points: np.ndarray,
    point_std: float,
    patches: float,
    top: float,
    bottom: tuple[float, float],
    equal_sides: bool = False,
    most_outline: int = 90,
    most_points: int = 200,
) -> Observation:
    """Collect what a refinement has to match; outline and points are thinned evenly to the given numbers.

    Args:
        frame: The picture.
        outline: The thing's own outline in [px], shape (k, 2).
        outline_std: How well each of its points is known in [px], shape (k,).
        points: In the world in [m], shape (n, 3).
        point_std: Spread of one point in [m].
        patches: Number of points that err independently.
        top: Height of the upper surface in [m].
        bottom: Height of the support and its spread, in [m].
        equal_sides: Whether the thing is known to be as long as wide as high.
        most_outline, most_points: How many to keep.
    """
    every = max(1, len(outline) // most_outline)
    outline, outline_std = outline[::every], outline_std[::every]
    points = points[:: max(1, len(points) // most_points)]
    return Observation(frame, outline, outline_std, points, point_std, patches, top, *bottom, equal_sides)


@dataclass(frozen=True)
class Minimum:
    """Where the sum of squares is smallest.

    Attributes:
        x: The parameters.
        covariance: Of x.
        rms: How far the outlines disagree in [px].
        cost: Sum of squares of everything but the prior, of any x, with the robust weights of the minimum.
    """

    x: NDArray[np.floating]
    covariance: NDArray[np.floating]
    rms: float
    cost: Callable[[np.ndarray], float]


def minimise(
    start: np.ndarray,
    loose: np.ndarray,
    vertices: Callable[[np.ndarray], np.ndarray],
    surface: Callable[[np.ndarray], np.ndarray] | None,
    seen: Observation,
    extra: Callable[[np.ndarray], np.ndarray] | None = None,
    rounds: int = 15,
) -> Minimum:
    """Damped Gauss-Newton.

    Args:
        start: First x; also the centre of the prior.
        loose: Spread of the prior, same shape.
        vertices: World points whose projected hull is the solid's outline.
        surface: Signed distances of the points to the surface in [m], or None to leave the points out.
        seen: What to match.
        extra: Further residuals, already divided by their spread.
        rounds: Most steps.
    """
    steps = np.minimum(loose * 0.02, 5e-4)
    # Neighbouring outline pixels share their error too: about three of them tell as much as one.
    outline_weight = 1.0 / (seen.outline_std * np.sqrt(3.0))
    point_weight = np.sqrt(min(1.0, seen.patches / max(len(seen.points), 1))) / max(seen.point_std, 1e-4)

    def residuals(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        parts, robust = [(x - start) / loose], [np.ones(len(x))]
        if len(seen.outline):
            off = outline_distance(seen.outline, project(vertices(x), seen.frame))
            parts.append(off * outline_weight)
            robust.append((1.0 + (off / (2.0 * seen.outline_std)) ** 2) ** -0.25)
        if surface is not None:
            off = surface(x)
            parts.append(off * point_weight)
            robust.append((1.0 + (off / (2.5 * seen.point_std)) ** 2) ** -0.25)
        if extra is not None:
            parts.append(extra(x))
            robust.append(np.ones(len(parts[-1])))
        return np.concatenate(parts), np.concatenate(robust)

    x, damping = start.copy(), 1e-3
    r, w = residuals(x)
    normal = np.eye(len(x))
    for _ in range(rounds):
        jacobian = np.stack(
            [
                (residuals(x + h * e)[0] - residuals(x - h * e)[0]) / (2 * h)
                for h, e in zip(steps, np.eye(len(x)), strict=True)
            ],
            -1,
        )
        jw, rw = jacobian * w[:, None], r * w
        normal = jw.T @ jw
        moved, step = False, np.zeros_like(x)
        for _ in range(6):
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), jw.T @ rw)
            r_new, w_new = residuals(x + step)
            if np.sum((r_new * w) ** 2) < np.sum(rw**2):
                x, r, w, damping, moved = x + step, r_new, w_new, max(damping / 5, 1e-6), True
                break
            damping *= 5
        if not moved or np.max(np.abs(step) / loose) < 2e-3:
            break
    rms = 0.0
    if len(seen.outline):
        rms = float(np.sqrt(np.mean(outline_distance(seen.outline, project(vertices(x), seen.frame)) ** 2)))
    own = len(x)
    return Minimum(x, np.linalg.inv(normal), rms, lambda y: float(np.sum((residuals(y)[0] * w)[own:] ** 2)))
