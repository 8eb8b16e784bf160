"""Round or angular: what the outline of a blob says about the thing behind it."""

from dataclasses import dataclass

import cv2
import numpy as np

MIXED_PX = 2  # contour points this near to where the thing goes on unseen are of both


@dataclass(frozen=True)
class Outline:
    """Measures of one blob's outline.

    Attributes:
        roundness: How much better an ellipse explains the free outline than a polygon: polygon's residual by the sum of
            both, 0..1. Rendered balls gave 0.63 to 0.85, vessels 0.48 to 0.93, cubes 0.06 to 0.42.
        aspect: Long side by short side of the smallest rectangle around it, >= 1.
        long_px: Long side of that rectangle in [px].
        fill: Share of the convex hull that the blob covers, of what nothing nearer hides, 0..1.
        free: Share of the outline that is the thing's own: neither cut by the picture nor hidden by something nearer.
    """

    roundness: float
    aspect: float
    long_px: float
    fill: float
    free: float


def longest_contour(mask: np.ndarray) -> np.ndarray:
    """Border pixels (x, y) of a mask's piece of longest border, in order, int, shape (n, 2)."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return max(contours, key=len).reshape(-1, 2) if contours else np.zeros((0, 2), int)


def outward_normals(contour: np.ndarray) -> np.ndarray:
    """Directions out of a closed contour (x, y), from its tangent smoothed over seven pixels, shape (n, 2)."""
    tangent = (np.roll(contour, -3, 0) - np.roll(contour, 3, 0)).astype(float)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], -1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    x, y = contour[:, 0].astype(float), contour[:, 1].astype(float)
    clockwise = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    return normal if clockwise >= 0 else -normal


def own_outline(
    contour: np.ndarray,
    blob: np.ndarray,
    depth: np.ndarray | None,
    nearer: float,
    covering: np.ndarray | None = None,
) -> np.ndarray:
    """Which contour points are the thing's own edge, bool, shape (n,).

    A point is not when it lies at the picture's border, when the pixel 3 px further out is nearer by `nearer` [m], or
    when that pixel belongs to something that stands on the thing and is not farther by `nearer`. Further out is across
    the contour: what reaches into the thing from one side, as a finger before it does, makes a dent whose points do not
    face away from the middle.

    Args:
        contour: Pixels (x, y), int, shape (n, 2).
        blob: Pixels of the thing, bool, shape (height, width).
        depth: In [m], NaN where unknown, same shape, or None.
        nearer: In [m].
        covering: Pixels of things that stand on or in the thing, bool, same shape, or None.
    """
    height, width = blob.shape
    x, y = contour[:, 0], contour[:, 1]
    own = (x > 1) & (y > 1) & (x < width - 2) & (y < height - 2)
    if depth is None:
        return own
    away = outward_normals(contour)
    limits = np.array([width - 1, height - 1])
    outer = np.clip(np.round(contour + 3.0 * away).astype(int), 0, limits)
    inner = np.clip(np.round(contour - 3.0 * away).astype(int), 0, limits)
    d_out, d_in = depth[outer[:, 1], outer[:, 0]], depth[inner[:, 1], inner[:, 0]]
    gap = d_in - d_out
    hidden = (gap > nearer) & ~blob[outer[:, 1], outer[:, 0]]
    if covering is not None:
        hidden |= covering[outer[:, 1], outer[:, 0]] & ~(gap < -nearer)
    return own & ~hidden


def _without_ends(own: np.ndarray) -> np.ndarray:
    """Own points of a closed contour without those within `MIXED_PX` of one that is not.

    Where an edge goes behind something, pixels are of both; and a spot that lies between hidden ones (a stem that the
    picture's border cuts) is no outline.
    """
    kept = own.copy()
    for shift in range(1, MIXED_PX + 1):
        kept &= np.roll(own, shift) & np.roll(own, -shift)
    return kept


def _hidden_area(blob: np.ndarray, hull: np.ndarray, depth: np.ndarray | None, nearer: float) -> int:
    """Pixels of a blob's hull, beyond the blob, that are nearer than (nine tenths of) the blob itself."""
    known = np.empty(0) if depth is None else depth[blob & np.isfinite(depth)]
    if depth is None or not len(known):
        return 0
    filled = np.zeros(blob.shape, np.uint8)
    cv2.fillConvexPoly(filled, hull.reshape(-1, 1, 2), 1)
    return int(np.count_nonzero((filled > 0) & ~blob & (depth < np.quantile(known, 0.1) - nearer)))


def _ellipse_residual(points: np.ndarray) -> float:
    """RMS distance of points to their own least-squares ellipse in [px], along rays from its centre."""
    (cx, cy), (full_a, full_b), angle = cv2.fitEllipse(points.astype(np.float32).reshape(-1, 1, 2))
    if not (np.isfinite([cx, cy, full_a, full_b]).all() and min(full_a, full_b) > 1.0):
        return np.inf
    if max(full_a, full_b) > 4.0 * float(np.ptp(points, axis=0).max()):
        return np.inf  # a nearly straight piece of outline: no ellipse worth the name
    t = np.radians(angle)
    d = points - (cx, cy)
    along = (d[:, 0] * np.cos(t) + d[:, 1] * np.sin(t)) / (full_a / 2)
    across = (-d[:, 0] * np.sin(t) + d[:, 1] * np.cos(t)) / (full_b / 2)
    ratio = np.hypot(along, across)
    radius = np.linalg.norm(d, axis=1)
    off = radius * (1.0 - 1.0 / np.maximum(ratio, 1e-6))
    return float(np.sqrt(np.mean(off**2)))


def _polygon_residual(points: np.ndarray, hull: np.ndarray, sides: int) -> float:
    """Spread of the distances of points to the smallest polygon of `sides` sides around the hull, in [px].

    The spread, not the size: the polygon lies around noisy points.
    """
    if len(hull) > sides:
        polygon = cv2.approxPolyN(hull.reshape(-1, 1, 2).astype(np.int32), sides).reshape(-1, 2).astype(float)
    else:
        polygon = hull.reshape(-1, 2).astype(float)
    start, edge = polygon, np.roll(polygon, -1, 0) - polygon
    length2 = np.maximum((edge**2).sum(1), 1e-9)
    along = np.clip(((points[:, None] - start) * edge).sum(-1) / length2, 0.0, 1.0)
    distance = np.linalg.norm(points[:, None] - (start + along[..., None] * edge), axis=-1).min(1)
    return float(np.std(distance))


def measure_outline(blob: np.ndarray, depth: np.ndarray | None = None, nearer: float = 0.012) -> Outline | None:
    """Measure a blob's outline; None for blobs of fewer than 12 outline points.

    Args:
        blob: bool, shape (height, width), one piece.
        depth: In [m], NaN where unknown, same shape; None to treat no part of the outline as hidden.
        nearer: By how much something in front has to be nearer in [m].
    """
    contour = longest_contour(blob)
    if len(contour) < 12:
        return None
    hull = cv2.convexHull(contour.reshape(-1, 1, 2)).reshape(-1, 2)
    (_, _), spans, _ = cv2.minAreaRect(hull.reshape(-1, 1, 2))
    long_px, short_px = max(spans) + 1.0, min(spans) + 1.0
    hull_area = float(cv2.contourArea(hull.reshape(-1, 1, 2).astype(np.float32))) + len(contour) / 2
    fill = min(1.0, float(blob.sum()) / (hull_area - _hidden_area(blob, hull, depth, nearer)))
    own = own_outline(contour, blob, depth, nearer)
    # Dents of the outline (a stem, a missing pixel) belong to neither an ellipse nor a box: keep what is on the hull.
    off_hull = np.array([cv2.pointPolygonTest(hull.reshape(-1, 1, 2), (float(x), float(y)), True) for x, y in contour])
    free = contour[_without_ends(own) & (off_hull < max(1.5, 0.04 * short_px))].astype(float)
    if len(free) < 12:
        return Outline(0.58, long_px / short_px, long_px, fill, float(own.mean()))
    # A box shows at most six edges from anywhere, of a half-hidden one three and the edge of what hides it.
    share = float(own.mean())
    sides = 6 if share > 0.95 else int(np.clip(round(6 * share) + 1, 4, 6))
    ellipse, polygon = _ellipse_residual(free), _polygon_residual(free, hull, sides)
    # Half a pixel of grid noise on both sides keeps tiny blobs undecided instead of sure.
    roundness = (polygon + 0.15) / (polygon + ellipse + 0.3) if np.isfinite(ellipse) else 0.0
    return Outline(roundness, long_px / short_px, long_px, fill, share)


def convex_outline(contour: np.ndarray, own: np.ndarray, deepest_px: float = 2.0) -> np.ndarray:
    """Which contour points can be of a convex solid's outline, bool, shape (n,): those of dents cannot.

    Args:
        contour: Border pixels (x, y) of the mask, in order, int, shape (n, 2).
        own: Points that are the thing's own edge, bool, shape (n,).
        deepest_px: Dents deeper than this are none of a convex solid's, in [px].
    """
    if len(contour) < 12:
        return np.zeros(len(contour), bool)
    hull = cv2.convexHull(contour.reshape(-1, 1, 2))
    dent = np.array([cv2.pointPolygonTest(hull, (float(x), float(y)), True) for x, y in contour])
    return own & (dent < deepest_px)


def outline_pixels(contour: np.ndarray, own: np.ndarray) -> np.ndarray:
    """The thing's own edge in sub-pixel coordinates, half a pixel outside the outermost pixels, shape (m, 2).

    Args:
        contour: Border pixels (x, y) of the mask, in order, int, shape (n, 2).
        own: Points that count, bool, shape (n,).
    """
    return (contour + 0.5 * outward_normals(contour))[own] if own.any() else np.zeros((0, 2))
