"""What simple solids cannot tell: the upright box around a thing of another form, and what lies beyond the border.

A kettle is a round body with a handle and a spout; no box, cylinder or ball has its outline. Fitting one to it all the
same gives a solid that fits the outline nowhere and claims a millimetre.
"""

from dataclasses import replace

import cv2
import numpy as np

from perception.frames import RgbdFrame
from perception.geometry.refinement import Refined
from perception.geometry.shape_choice import Kind
from perception.geometry.solids import Solid, fit_box
from perception.geometry.surface_distance import surface_distance

# Rendered cubes, balls, cans and crates left at most 1.4 px and 5 % of their points, with masks 3 px too wide as well;
# most kettles left more than 2.5 px or more than 8 %.
MOST_OUTLINE_PX = 2.0
MOST_OFF_SHARE = 0.06
FIT_STD = 0.0015  # how far a fit of the right solid is off its own points in [m]
TRIM = 0.001  # share of points left out at each end: a spout is few points
EDGE_PX = 1.5  # pixels beside a depth step are not used, and the outermost pixel's own half
HIDDEN_SHARE = 0.10  # which part of its size such a thing may have where nobody looks
CUT_SHARE = 0.5  # the same for a side at which the picture ends
LEAST_UNSEEN = 0.08  # less of an outline that is not an end is noise
GOES_ON = 2.0  # by how many times the unseen share of its outline a thing of any form may be longer than it looks
SYMMETRIC = 0.93  # a hull of which its mirror image covers this share has an axis of symmetry
NEAR_FACE = 0.15  # points within this share of the size are at a face


def is_explained(kind: Kind, fitted: Refined, points: np.ndarray, depth_std: float) -> bool:
    """Whether a fitted solid has about the outline and the surface that were seen.

    Args:
        kind: What the solid is.
        fitted: After refinement.
        points: In the world in [m], shape (n, 3).
        depth_std: Spread of one point in [m].
    """
    if fitted.outline_rms > MOST_OUTLINE_PX:  # false where no outline was fitted
        return False
    off = np.abs(surface_distance(kind, fitted.solid, points))
    return bool(np.mean(off > 3.0 * np.hypot(depth_std, FIT_STD)) <= MOST_OFF_SHARE)


def box_around(
    frame: RgbdFrame, used: np.ndarray, points: np.ndarray, bottom: tuple[float, float], depth_std: float
) -> Refined:
    """Upright box around the points, down to the support; its x axis is the longer level one, towards the thin end.

    The spread is how far the points lie inside the box, a share of its size, and much more along an axis at whose
    face the picture ends.

    Args:
        frame: The picture.
        used: Pixels of the points, bool, shape (height, width).
        points: In the world in [m], in the order of the pixels, shape (n, 3).
        bottom: Height of the support and its spread, in [m].
        depth_std: Spread of one point in [m].
    """
    yaw = _direction(points[:, :2], fit_box(points, bottom[0], depth_std, TRIM).yaw)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    low, high = np.quantile(points[:, :2] @ turn, (TRIM, 1.0 - TRIM), axis=0)
    edge = EDGE_PX * float(np.median(frame.depth[used])) / frame.intrinsics.fx
    top = float(np.quantile(points[:, 2], 0.995))
    tall = max(top - bottom[0], 0.004)
    extents = np.array([*(high - low + 2.0 * edge), tall])
    centre = np.array([*(turn @ (low + high) / 2), top - tall / 2])
    if extents[0] < extents[1]:
        extents, yaw = extents[[1, 0, 2]], yaw + np.pi / 2
    solid = Solid("box", centre, yaw, extents)
    local = (points - solid.centre) @ solid.pose[:3, :3]
    if _width(local, local[:, 0] < -0.3 * extents[0]) < _width(local, local[:, 0] > 0.3 * extents[0]):
        solid = Solid("box", solid.centre, yaw - np.pi if yaw > 0.0 else yaw + np.pi, extents)
    off = float(np.mean(np.abs(surface_distance("box", solid, points))))
    sizes = np.hypot(off, HIDDEN_SHARE * extents)
    # The top is seen, and what it stands on is known.
    sizes[2] = np.hypot(0.3 * off, bottom[1])
    at_face = np.abs(local[_at_border(used)[used]]) > (0.5 - NEAR_FACE) * extents
    sizes = np.where(at_face.sum(0) >= 5, np.hypot(sizes, CUT_SHARE * extents), sizes)
    c, s = np.abs(np.cos(yaw)), np.abs(np.sin(yaw))
    level = np.hypot([c * sizes[0], s * sizes[0]], [s * sizes[1], c * sizes[1]])
    position = np.array([*level, sizes[2]]) / 2
    return Refined(solid, position, float(np.arctan2(sizes[1], extents[0])), float("nan"), sizes)


def with_cut_top(fitted: Refined, used: np.ndarray, points: np.ndarray) -> Refined:
    """The same box or cylinder, less sure where its upper end lies beyond the picture's border.

    Points and outline agree with any greater height then, and with no top in sight no more than the faces towards the
    camera are known of a box.

    Args:
        fitted: After refinement.
        used: Pixels of the points, bool, shape (height, width).
        points: In the world in [m], in the order of the pixels, shape (n, 3).
    """
    solid = fitted.solid
    highest = solid.top - NEAR_FACE * solid.extents[2]
    if solid.shape == "sphere" or (points[_at_border(used)[used], 2] > highest).sum() < 5:
        return fitted
    more = CUT_SHARE * solid.extents
    if solid.shape == "box":
        more[:2] = CUT_SHARE * solid.extents[:2].max()
    else:
        more[:2] = 0.0
    position = np.hypot(fitted.position_std, more / 2)
    return replace(fitted, position_std=position, extents_std=np.hypot(fitted.extents_std, more))


def with_unseen_rest(fitted: Refined, unseen: float) -> Refined:
    """The same solid, less sure where a part of its outline is not its own: a thing of any form may go on there.

    What is seen of a thing that is no simple solid often looks like one: of a kettle behind a can, its handle.

    Args:
        fitted: After refinement.
        unseen: Share of the outline that is hidden, cut, or not shown to be an end, 0..1.
    """
    if unseen < LEAST_UNSEEN:
        return fitted
    level = min(1.0, GOES_ON * unseen) * float(fitted.solid.extents[:2].max())
    more = np.array([level, level, 0.0])
    sizes = np.hypot(fitted.extents_std, more)
    turned = float(np.hypot(fitted.yaw_std, np.arctan2(level, fitted.solid.extents[:2].max())))
    return replace(fitted, position_std=np.hypot(fitted.position_std, more / 2), extents_std=sizes, yaw_std=turned)


def _direction(places: np.ndarray, tightest: float) -> float:
    """Yaw of a thing seen from above in [rad]: its axis of symmetry where it has one, else its smallest rectangle's.

    The smallest rectangle turns until a spout fits into its corner. The hull's principal axis, along which its second
    moment is largest, is the axis of any mirror symmetry, but parallel to neither side of a box with an open door.

    Args:
        places: Of its points, in [m], shape (n, 2).
        tightest: Yaw of the smallest rectangle in [rad].
    """
    low, high = np.quantile(places, (TRIM, 1.0 - TRIM), axis=0)
    inner = places[np.all((places >= low) & (places <= high), axis=1)]
    middle = inner.mean(0)
    # In millimetres, because OpenCV takes polygons of less than some 1e-6 for empty.
    hull = cv2.convexHull((1e3 * (inner - middle)).astype(np.float32)).reshape(-1, 2)
    m = cv2.moments(hull.reshape(-1, 1, 2))
    if m["m00"] < 1.0:
        return tightest
    principal = 0.5 * float(np.arctan2(2.0 * m["mu11"], m["mu20"] - m["mu02"]))
    hull = hull - np.array([m["m10"], m["m01"]], np.float32) / np.float32(m["m00"])
    alike = _mirrored(hull, principal)
    return principal if alike > max(SYMMETRIC, _mirrored(hull, tightest)) else tightest


def _mirrored(hull: np.ndarray, yaw: float) -> float:
    """Largest share of a convex hull that its mirror image about the axis at `yaw` [rad], or across it, covers."""
    c, s = np.cos(2.0 * yaw), np.sin(2.0 * yaw)
    image = (hull @ np.array([[c, s], [s, -c]])).astype(np.float32)
    area = cv2.contourArea(hull)
    return max(cv2.intersectConvexConvex(hull, other)[0] / area for other in (image, -image))


def _width(local: np.ndarray, chosen: np.ndarray) -> float:
    """Spread of some points across the x axis in [m]; 0 for fewer than five."""
    return float(np.std(local[chosen, 1])) if chosen.sum() >= 5 else 0.0


def _at_border(pixels: np.ndarray, reach: int = 4) -> np.ndarray:
    """Which pixels lie within `reach` [px] of the picture's border, bool, same shape."""
    near = pixels.copy()
    near[reach:-reach, reach:-reach] = False
    return near
