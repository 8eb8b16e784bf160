"""Refinement of an upright solid: its outline must match the mask's, its faces must match the points.

Outline pixels are sharp across the ray and depth is noisy along it, so the outline fixes place, size and turn across
the ray and the mean of many depths fixes the distance. Minimised over the parameters x by Gauss-Newton with damping:

    sum_i (w_i r_i(x))^2,   r = outline distances [px], point-to-surface distances [m], and soft priors

with robust weights 1 / sqrt(1 + (r/s)^2) on outline and points. The inverse of J^T J at the end is the covariance
of x, which says by itself how little a half-hidden thing tells.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from perception.frames import RgbdFrame
from perception.geometry.solids import Solid

OUTLINE_STD_PX = 1.0  # how well a mask's edge is known
EQUAL_SIDES_STD = 0.004  # how unequal the sides of what people call a cube are, in [m]
ELONGATION_STD = 0.15  # by which share an egg's or a lemon's sizes differ from their mean
SYSTEMATIC_STD = 0.0008  # what calibration and sampling leave, in [m]


@dataclass(frozen=True)
class Observation:
    """What a refinement has to match.

    Attributes:
        frame: The picture.
        outline: The thing's own outline in [px], shape (m, 2); empty when all of it is hidden.
        points: Trusted points in the world in [m], shape (n, 3).
        point_std: Spread of one point along its ray in [m].
        patches: Number of points that err independently of each other.
        top: Height of the upper surface in [m], as the points say.
        bottom: Height of the supporting surface in [m].
        bottom_std: Its spread in [m].
        equal_sides: Whether the thing is known to be as long as wide as high.
    """

    frame: RgbdFrame
    outline: np.ndarray
    points: np.ndarray
    point_std: float
    patches: float
    top: float
    bottom: float
    bottom_std: float
    equal_sides: bool = False


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
    position_std: np.ndarray
    yaw_std: float
    outline_rms: float
    extents_std: np.ndarray


def observe(
    frame: RgbdFrame,
    outline: np.ndarray,
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
        points: In the world in [m], shape (n, 3).
        point_std: Spread of one point in [m].
        patches: Number of points that err independently.
        top: Height of the upper surface in [m].
        bottom: Height of the support and its spread, in [m].
        equal_sides: Whether the thing is known to be as long as wide as high.
        most_outline, most_points: How many to keep.
    """
    outline = outline[:: max(1, len(outline) // most_outline)]
    points = points[:: max(1, len(points) // most_points)]
    return Observation(frame, outline, points, point_std, patches, top, *bottom, equal_sides)


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
        return _box_distance(build(x), seen.points)

    def corners(x: np.ndarray) -> np.ndarray:
        return box_corners(build(x))

    def alike(x: np.ndarray) -> np.ndarray:
        return np.array([x[3] - x[4], (x[3] + x[4]) / 2 - (x[5] - x[6])]) / EQUAL_SIDES_STD

    best = _minimise(start, loose, corners, surface, seen, alike if seen.equal_sides else None)
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
    yaw_std = float(np.sqrt(covariance[2, 2]))
    fitted = build(best.x)
    turned = _nearest_turn(fitted)
    if round((fitted.yaw - turned.yaw) / (np.pi / 2)) % 2:
        sizes = sizes[[1, 0, 2]]
    return Refined(turned, _floor(variance), yaw_std, best.rms, _floor(sizes))


def _unseen_growth(best: "_Minimum", outwards: np.ndarray) -> float:
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

    best = _minimise(start, loose, rim, surface, seen, rests)
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

    best: _Minimum | None = None
    for yaw in np.radians((0.0, 60.0, 120.0)):
        start = np.array([*ball.centre, 1.1 * size, 0.95 * size, 0.95 * size, yaw])
        found = _minimise(start, loose, rim, surface, seen, rests)
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


def ellipsoid_distance(solid: Solid, points: np.ndarray) -> np.ndarray:
    """Signed distance of points to an ellipsoid's surface in [m] to first order, negative inside, shape (n,)."""
    half = solid.extents / 2
    q = (points - solid.centre) @ solid.pose[:3, :3] / half
    away = np.linalg.norm(q, axis=1)
    return (away - 1.0) * away / np.maximum(np.linalg.norm(q / half, axis=1), 1e-9)


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

    best = _minimise(start, loose, rims, None, seen, height)
    x, covariance = best.x, best.covariance
    tall, wide = max(x[3] - x[4], 0.003), 2.0 * max(x[2], 0.003)
    fitted = Solid("cylinder", np.array([x[0], x[1], x[3] - tall / 2]), 0.0, np.array([wide, wide, tall]))
    variance = np.array([covariance[0, 0], covariance[1, 1], (covariance[3, 3] + covariance[4, 4]) / 4])
    sizes = np.array([4.0 * covariance[2, 2], 4.0 * covariance[2, 2], covariance[3, 3] + covariance[4, 4]])
    return Refined(fitted, _floor(variance), float("inf"), best.rms, _floor(sizes))


def _floor(variance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(variance, 0.0) + SYSTEMATIC_STD**2)


def _nearest_turn(solid: Solid) -> Solid:
    """The same box with its yaw in [0, 90) degrees; sides are swapped where a quarter turn is taken away."""
    quarters = int(np.floor(solid.yaw / (np.pi / 2)))
    x, y, z = solid.extents
    extents = np.array([y, x, z]) if quarters % 2 else solid.extents
    return replace(solid, yaw=solid.yaw - quarters * np.pi / 2, extents=extents)


def box_corners(solid: Solid) -> np.ndarray:
    """Corners of an upright box in the world in [m], shape (8, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    pose = solid.pose
    return (signs * solid.extents / 2) @ pose[:3, :3].T + pose[:3, 3]


def sphere_rim(centre: np.ndarray, radius: float, eye: np.ndarray, segments: int = 40) -> np.ndarray:
    """The circle of a sphere's surface that an eye sees as its outline, in the world in [m], shape (segments, 3).

    For an eye at distance d it lies at r^2 / d from the centre towards the eye and has radius r sqrt(1 - (r/d)^2).
    """
    towards = eye - centre
    distance = max(float(np.linalg.norm(towards)), 1e-6)
    towards = towards / distance
    share = min(radius / distance, 0.999)
    side = np.cross(towards, [0.0, 0.0, 1.0] if abs(towards[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(towards, side)
    t = np.linspace(0.0, 2.0 * np.pi, segments, endpoint=False)[:, None]
    ring = radius * np.sqrt(1.0 - share**2) * (np.cos(t) * side + np.sin(t) * other)
    return centre + radius * share * towards + ring


def _box_distance(solid: Solid, points: np.ndarray) -> np.ndarray:
    """Signed distance of points to a box's surface in [m], negative inside, shape (n,)."""
    pose = solid.pose
    beyond = np.abs((points - pose[:3, 3]) @ pose[:3, :3]) - solid.extents / 2
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return outside + np.minimum(beyond.max(1), 0.0)


def outline_distance(outline: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Signed distance of pixels to the convex hull of projected vertices in [px], negative inside, shape (m,).

    The largest distance to the hull's edge lines: exact beside edges, slightly too small off corners.
    """
    order = cv2.convexHull(vertices.astype(np.float32).reshape(-1, 1, 2), returnPoints=False)
    hull = vertices[np.asarray(order, dtype=np.intp).ravel()]
    edge = np.roll(hull, -1, 0) - hull
    length = np.linalg.norm(edge, axis=1)
    hull, edge = hull[length > 1e-9], edge[length > 1e-9] / length[length > 1e-9, None]
    normal = np.stack([edge[:, 1], -edge[:, 0]], -1)
    inward = ((hull.mean(0) - hull) * normal).sum(1) > 0
    normal[inward] *= -1.0
    return ((outline[:, None] - hull) * normal).sum(-1).max(1)


def _project(points: np.ndarray, frame: RgbdFrame) -> np.ndarray:
    pose, k = frame.world_T_camera, frame.intrinsics
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    z = np.maximum(local[:, 2], 0.02)
    return np.stack([k.fx * local[:, 0] / z + k.cx, k.fy * local[:, 1] / z + k.cy], -1)


@dataclass(frozen=True)
class _Minimum:
    """Where the sum of squares is smallest.

    Attributes:
        x: The parameters.
        covariance: Of x.
        rms: How far the outlines disagree in [px].
        cost: Sum of squares of everything but the prior, of any x, with the robust weights of the minimum.
    """

    x: np.ndarray
    covariance: np.ndarray
    rms: float
    cost: Callable[[np.ndarray], float]


def _minimise(
    start: np.ndarray,
    loose: np.ndarray,
    vertices: Callable[[np.ndarray], np.ndarray],
    surface: Callable[[np.ndarray], np.ndarray] | None,
    seen: Observation,
    extra: Callable[[np.ndarray], np.ndarray] | None = None,
    rounds: int = 15,
) -> _Minimum:
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
    outline_weight = 1.0 / (OUTLINE_STD_PX * np.sqrt(3.0))
    point_weight = np.sqrt(min(1.0, seen.patches / max(len(seen.points), 1))) / max(seen.point_std, 1e-4)

    def residuals(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        parts, robust = [(x - start) / loose], [np.ones(len(x))]
        if len(seen.outline):
            off = outline_distance(seen.outline, _project(vertices(x), seen.frame))
            parts.append(off * outline_weight)
            robust.append((1.0 + (off / (2.0 * OUTLINE_STD_PX)) ** 2) ** -0.25)
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
        rms = float(np.sqrt(np.mean(outline_distance(seen.outline, _project(vertices(x), seen.frame)) ** 2)))
    own = len(x)
    return _Minimum(x, np.linalg.inv(normal), rms, lambda y: float(np.sum((residuals(y)[0] * w)[own:] ** 2)))
