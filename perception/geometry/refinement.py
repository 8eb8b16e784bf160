"""Refinement of an upright solid: its outline must match the mask's, its faces must match the points.

What is minimised, and how, stands in `perception.geometry.outline_fit`; here are the parameters of each kind of solid,
what is known about them beforehand, and what their spreads mean for place and sizes.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from perception.geometry.outline_fit import Minimum, Observation, minimise
from perception.geometry.solid_outlines import box_corners, sphere_rim
from perception.geometry.solids import Solid
from perception.geometry.surface_distance import box_distance, ellipsoid_distance

EQUAL_SIDES_STD = 0.004  # how unequal the sides of what people call a cube are, in [m]
ELONGATION_STD = 0.15  # by which share an egg's or a lemon's sizes differ from their mean
SYSTEMATIC_STD = 0.0008  # what calibration and sampling leave, in [m]


@dataclass(frozen=True)
class Refined:
    """A refined solid with its spread.

    Attributes:
        solid: The solid.
        position_std: Of its centre along the world's axes in [m], shape (3,).
        yaw_std: Of its yaw in [rad]; infinite for round solids.
        outline_rms: How far the outlines disagree in [px]; NaN where no outline was fitted.
        extents_std: Of its sizes in [m], shape (3,); large for a side that is hidden or not seen.
    """

    solid: Solid
    position_std: NDArray[np.float64]
    yaw_std: float
    outline_rms: float
    extents_std: NDArray[np.float64]


def refine(solid: Solid, seen: Observation) -> Refined:
    """The solid that matches outline and points best, starting from a first fit."""
    if solid.shape == "sphere":
        return _refine_sphere(solid, seen)
    if solid.shape == "cylinder":
        return _refine_cylinder(solid, seen)
    return _refine_box(solid, seen)


def _refine_box(solid: Solid, seen: Observation) -> Refined:
    """X = (centre x, centre y, yaw, size x, size y, top, bottom)."""
    start = np.array([*solid.centre[:2], solid.yaw, *solid.extents[:2], solid.top, seen.bottom])
    loose = np.array([0.03, 0.03, 0.35, 0.04, 0.04, 0.03, seen.bottom_std])

    def build(x: np.ndarray) -> Solid:
        tall = max(x[5] - x[6], 0.003)
        extents = np.array([max(x[3], 0.003), max(x[4], 0.003), tall])
        return Solid("box", np.array([x[0], x[1], x[5] - tall / 2]), float(x[2]), extents)

    def surface(x: np.ndarray) -> np.ndarray:
        return box_distance(build(x), seen.points)

    def corners(x: np.ndarray) -> np.ndarray:
        return box_corners(build(x))

    def alike(x: np.ndarray) -> np.ndarray:
        return np.array([x[3] - x[4], (x[3] + x[4]) / 2 - (x[5] - x[6])]) / EQUAL_SIDES_STD

    best = minimise(start, loose, corners, surface, seen, alike if seen.equal_sides else None)
    covariance = best.covariance
    variance = np.array([covariance[0, 0], covariance[1, 1], (covariance[5, 5] + covariance[6, 6]) / 4])
    sizes = np.array([covariance[3, 3], covariance[4, 4], covariance[5, 5] + covariance[6, 6]])
    c, s = np.cos(best.x[2]), np.sin(best.x[2])
    for axis, way in ((0, np.array([c, s])), (1, np.array([-s, c]))):
        for sign in (1.0, -1.0):
            outwards = np.zeros(7)
            outwards[:2], outwards[3 + axis] = sign * way / 2, 1.0
            growth = _unseen_growth(best, outwards)
            variance[:2] += (way * growth / 2) ** 2
            sizes[axis] += growth**2
    # Whatever the outline says, the height is known no better than the foot.
    variance[2], sizes[2] = max(variance[2], seen.bottom_std**2 / 4), max(sizes[2], seen.bottom_std**2)
    yaw_std = float(np.sqrt(covariance[2, 2]))
    fitted = build(best.x)
    turned = _nearest_turn(fitted)
    if round((fitted.yaw - turned.yaw) / (np.pi / 2)) % 2:
        sizes = sizes[[1, 0, 2]]
    return Refined(turned, _floor(variance), yaw_std, best.rms, _floor(sizes))


def _unseen_growth(best: "Minimum", outwards: np.ndarray) -> float:
    """How far a face may move out before outline and points object, in [m]; 0 for a face that is seen.

    A box with a face that is hidden, or lies beyond the picture's border, always ends where its points end, and the
    slopes there do not tell that it may go on.

    Args:
        best: The minimum.
        outwards: By how much x changes when the face moves out by one metre, shape as x.
    """
    allowed = 0.0
    for growth in (0.005, 0.01, 0.02, 0.04):
        if best.cost(best.x + growth * outwards) > best.cost(best.x) + 1.0:
            break
        allowed = growth
    return allowed


def _refine_sphere(solid: Solid, seen: Observation) -> Refined:
    """X = (centre, radius, bottom); the bottom is drawn to the support as strongly as its spread says."""
    start = np.array([*solid.centre, solid.extents[0] / 2])
    loose = np.array([0.03, 0.03, 0.03, 0.03])
    eye = seen.frame.world_T_camera[:3, 3]

    def surface(x: np.ndarray) -> np.ndarray:
        return np.linalg.norm(seen.points - x[:3], axis=1) - x[3]

    def rim(x: np.ndarray) -> np.ndarray:
        return sphere_rim(x[:3], x[3], eye)

    def rests(x: np.ndarray) -> np.ndarray:
        return np.array([(x[2] - x[3] - seen.bottom) / seen.bottom_std])

    best = minimise(start, loose, rim, surface, seen, rests)
    x, covariance = best.x, best.covariance
    fitted = Solid("sphere", x[:3], 0.0, np.full(3, 2.0 * max(x[3], 0.003)))
    sizes = _floor(np.full(3, 4.0 * covariance[3, 3]))
    return Refined(fitted, _floor(np.diag(covariance)[:3]), float("inf"), best.rms, sizes)


def refine_ellipsoid(ball: Solid, seen: Observation) -> Refined:
    """Ellipsoid of which two axes are level: x = (centre, its three sizes, yaw), starting from a ball's fit.

    The fit is begun with the longer level axis in three directions and the best end is kept: from a ball the yaw has
    no slope. An affine map that makes the ellipsoid a unit sphere keeps lines of sight, so that the outline is the
    unit sphere's. A point p in the axes divided by half the sizes h has q = p / h and lies, to first order,
    (|q| - 1) |q| / |q / h| from the surface. The shape is still called a sphere, with three sizes.
    """
    size = float(ball.extents[0])
    loose = np.array([0.03, 0.03, 0.03, *np.full(3, ELONGATION_STD * size), 0.8])
    eye = seen.frame.world_T_camera[:3, 3]

    def build(x: np.ndarray) -> Solid:
        return Solid("sphere", x[:3], float(x[6]), np.maximum(x[3:6], 0.006))

    def surface(x: np.ndarray) -> np.ndarray:
        return ellipsoid_distance(build(x), seen.points)

    def rim(x: np.ndarray) -> np.ndarray:
        solid = build(x)
        turn, half = solid.pose[:3, :3], solid.extents / 2
        ring = sphere_rim(np.zeros(3), 1.0, (eye - solid.centre) @ turn / half)
        return (ring * half) @ turn.T + solid.centre

    def rests(x: np.ndarray) -> np.ndarray:
        return np.array([(x[2] - x[5] / 2 - seen.bottom) / seen.bottom_std])

    best: Minimum | None = None
    for yaw in np.radians((0.0, 60.0, 120.0)):
        start = np.array([*ball.centre, 1.1 * size, 0.95 * size, 0.95 * size, yaw])
        found = minimise(start, loose, rim, surface, seen, rests)
        if best is None or found.cost(found.x) < best.cost(best.x):
            best = found
    assert best is not None
    fitted, covariance = build(best.x), best.covariance
    sizes = _floor(np.diag(covariance)[3:6])
    if fitted.extents[0] < fitted.extents[1]:
        order = [1, 0, 2]
        fitted = replace(fitted, yaw=fitted.yaw + np.pi / 2, extents=fitted.extents[order])
        sizes = sizes[order]
    fitted = replace(fitted, yaw=float(fitted.yaw % np.pi))
    yaw_std = float(np.sqrt(covariance[6, 6]))
    return Refined(fitted, _floor(np.diag(covariance)[:3]), yaw_std, best.rms, sizes)


def _refine_cylinder(solid: Solid, seen: Observation) -> Refined:
    """X = (centre x, centre y, radius, top, bottom, foot radius / radius); the foot of a bowl is narrower.

    Points constrain the top alone: inside an open vessel they lie inside the solid.
    """
    start = np.array([*solid.centre[:2], solid.extents[0] / 2, solid.top, seen.bottom, 0.85])
    loose = np.array([0.03, 0.03, 0.03, 0.02, seen.bottom_std, 0.15])
    turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], -1)
    top_std = np.hypot(seen.point_std / np.sqrt(max(seen.patches / 4, 1.0)), 0.002)

    def rims(x: np.ndarray) -> np.ndarray:
        foot = float(np.clip(x[5], 0.3, 1.0))
        upper = np.c_[x[:2] + x[2] * circle, np.full(40, x[3])]
        return np.concatenate([upper, np.c_[x[:2] + foot * x[2] * circle, np.full(40, x[4])]])

    def height(x: np.ndarray) -> np.ndarray:
        return np.array([(x[3] - seen.top) / top_std, 10.0 * max(0.0, x[5] - 1.0)])

    best = minimise(start, loose, rims, None, seen, height)
    x, covariance = best.x, best.covariance
    tall, wide = max(x[3] - x[4], 0.003), 2.0 * max(x[2], 0.003)
    fitted = Solid("cylinder", np.array([x[0], x[1], x[3] - tall / 2]), 0.0, np.array([wide, wide, tall]))
    variance = np.array([covariance[0, 0], covariance[1, 1], (covariance[3, 3] + covariance[4, 4]) / 4])
    sizes = np.array([4.0 * covariance[2, 2], 4.0 * covariance[2, 2], covariance[3, 3] + covariance[4, 4]])
    variance[2], sizes[2] = max(variance[2], seen.bottom_std**2 / 4), max(sizes[2], seen.bottom_std**2)
    return Refined(fitted, _floor(variance), float("inf"), best.rms, _floor(sizes))


def _floor(variance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(variance, 0.0) + SYSTEMATIC_STD**2)


def _nearest_turn(solid: Solid) -> Solid:
    """The same box with its yaw in [0, 90) degrees; sides are swapped where a quarter turn is taken away."""
    quarters = int(np.floor(solid.yaw / (np.pi / 2)))
    x, y, z = solid.extents
    extents = np.array([y, x, z]) if quarters % 2 else solid.extents
    return replace(solid, yaw=solid.yaw - quarters * np.pi / 2, extents=extents)
