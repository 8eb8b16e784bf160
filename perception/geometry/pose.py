"""From one mask to one upright solid with a spread."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.geometry.cloud import largest_cluster
from perception.geometry.free_form import box_around, is_explained, with_cut_top, with_unseen_rest
from perception.geometry.mask_edges import mask_edges
from perception.geometry.outline import convex_outline, longest_contour, outline_pixels
from perception.geometry.outline_fit import OUTLINE_STD_PX, UNKNOWN_STD_PX, observe
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.refinement import Refined, refine, refine_ellipsoid
from perception.geometry.resting import LowerEnd, find_bottom, lower_end
from perception.geometry.shape_choice import ANY_KIND, Kind, best_of, first_fits, lying, with_others
from perception.geometry.solids import Solid
from perception.geometry.support import SupportPlane

VESSEL_FLOOR_STD = 0.006  # how far the floor of a bowl may lie above what the bowl stands on, in [m]


@dataclass(frozen=True)
class PoseSettings:
    """Settings of the pose estimate.

    Attributes:
        least_depth_share: Below this share of a mask's pixels with known depth there is no pose.
        least_points: Below this number of usable points there is no pose.
        clearance: Points lower than this above the support may be the support's, in [m].
    """

    least_depth_share: float = 0.30
    least_points: int = 40
    clearance: float = 0.004


@dataclass(frozen=True)
class MaskedCloud:
    """The trusted points of one mask.

    Attributes:
        mask: bool, shape (height, width).
        used: Those of its pixels that became points, bool, same shape.
        points: In the world in [m], shape (n, 3).
        depth_share: Share of the mask whose depth was measured, 0..1.
        depth_std: Spread of one point along its ray in [m].
        end: What the picture says about the lower end.
        whole: The mask with what something nearer hides between its pieces, bool, same shape.
        contour: Border pixels (x, y) of the whole, in order, int, shape (m, 2).
    """

    mask: NDArray[np.bool_]
    used: NDArray[np.bool_]
    points: NDArray[np.float64]
    depth_share: float
    depth_std: float
    end: LowerEnd
    whole: NDArray[np.bool_]
    contour: NDArray[np.int32]

    @property
    def lowest(self) -> float:
        """Height of the lowest visible points in [m]."""
        return float(np.quantile(self.points[:, 2], 0.02))


def masked_cloud(
    frame: PreparedFrame,
    mask: np.ndarray,
    table: SupportPlane,
    settings: PoseSettings,
    behind: np.ndarray | None = None,
) -> MaskedCloud | str:
    """Trusted points of a mask, or the reason why there are too few.

    Args:
        frame: The picture.
        mask: Pixels of the thing, bool, shape (height, width).
        table: Where the table is.
        settings: Of the estimate.
        behind: Pixels between its pieces where something nearer hides it, bool, same shape; None for one piece.
    """
    size = int(mask.sum())
    if size == 0:
        return "nothing stands out inside its box"
    known = mask & frame.valid_depth
    share = float((mask & frame.measured_depth).sum() / size)
    if share < settings.least_depth_share:
        return f"not enough depth ({share:.0%} of its pixels, {settings.least_depth_share:.0%} are needed)"
    used = known & frame.trusted_depth
    if used.sum() < max(settings.least_points, 0.3 * known.sum()):
        used = known  # a thing so small or thin that all of it lies beside a step
    points = frame.points(used)
    keep = points[:, 2] > table.at(points[:, 0], points[:, 1]) + settings.clearance
    if behind is None:
        keep[keep] = largest_cluster(points[keep])
    else:
        keep &= _each_pieces_cluster(used, points, keep)
    used = used.copy()
    used[used] = keep
    points = points[keep]
    if len(points) < settings.least_points:
        return f"too few usable depth points ({len(points)}, {settings.least_points} are needed)"
    std = frame.depth_std(float(np.median(frame.depth[used])))
    whole = mask if behind is None else mask | behind
    contour = longest_contour(whole)
    end = lower_end(frame, contour, np.median(points, 0))
    return MaskedCloud(mask, used, points, share, std, end, whole, contour)


def _each_pieces_cluster(used: np.ndarray, points: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """Which points lie in the largest cluster of their piece of the mask, bool, shape (n,).

    Args:
        used: Pixels of the points, bool, shape (height, width).
        points: In the world in [m], in the order of the pixels, shape (n, 3).
        keep: Those that count, bool, shape (n,).
    """
    # Depth steps leave gaps of a pixel or two in what is one piece.
    grown = cv2.dilate(used.astype(np.uint8), np.ones((5, 5), np.uint8))
    _, labels = cv2.connectedComponents(grown, connectivity=8)
    piece = labels[used]
    kept = np.zeros(len(points), bool)
    for label in np.unique(piece[keep]):
        own = keep & (piece == label)
        kept[own] = largest_cluster(points[own])
    return kept


def fit_solid(
    frame: PreparedFrame,
    cloud: MaskedCloud,
    shapes: Sequence[Kind],
    table: SupportPlane,
    others: Sequence[Solid],
    covering: np.ndarray | None = None,
    vessels: Sequence[Solid] = (),
    equal_sides: bool = False,
) -> Refined:
    """Solid that rests on the table or on one of the others, with its spread.

    Args:
        frame: The picture.
        cloud: Trusted points of the thing.
        shapes: Solids that it may be; of several the one is taken that its points say it is.
        table: Where the table is.
        others: Solids already fitted, one of which may carry the thing.
        covering: Pixels of things that stand higher and may hide it, bool, shape (height, width), or None.
        vessels: Hollow solids already fitted; a thing inside one rests on a floor that may not be seen.
        equal_sides: Whether the thing is known to be as long as wide as high.
    """
    x, y = np.median(cloud.points[:, 0]), np.median(cloud.points[:, 1])
    inside = any(v.covers(x, y) and cloud.lowest < v.top for v in vessels)
    bottom = find_bottom(cloud.points, cloud.end, table, others, cloud.depth_std, _around(frame, cloud))
    if inside:
        bottom = (bottom[0], max(bottom[1], VESSEL_FLOOR_STD))
    first = first_fits(cloud.points, shapes, bottom[0], cloud.depth_std)
    measured = float(frame.measured_depth[cloud.used].mean())
    patches = max(1.0, measured * len(cloud.points) / frame.noise.patch_px)
    edges = mask_edges(frame, cloud.contour, cloud.whole, bottom[0], covering)
    own = convex_outline(cloud.contour, edges.ends | edges.unknown)
    outline = outline_pixels(cloud.contour, own)
    outline_std = np.where(edges.unknown, UNKNOWN_STD_PX, OUTLINE_STD_PX)[own]
    refined: dict[Kind, Refined] = {}
    for kind, solid in first.items():
        if kind == "lying cylinder":
            refined[kind] = lying(solid, cloud.depth_std)
            continue
        rests = bottom
        # A ball shows where it ends: it is drawn to the support only where it seems to lie on it.
        if kind in ("sphere", "ellipsoid") and (
            inside or abs(solid.bottom - bottom[0]) > 0.012 + 2.0 * cloud.depth_std
        ):
            rests = (solid.bottom, 1.0)
        seen = observe(
            frame, outline, outline_std, cloud.points, cloud.depth_std, patches, solid.top, rests, equal_sides
        )
        fitted = refine_ellipsoid(solid, seen) if kind == "ellipsoid" else refine(solid, seen)
        refined[kind] = with_cut_top(fitted, cloud.used, cloud.points)
    if len(refined) == 1:
        return next(iter(refined.values()))
    best, likely = best_of(first, refined, cloud.points, cloud.depth_std)
    # A noun that is known says what the solid is, even where its label is bent or its outline spoilt.
    if tuple(shapes) != ANY_KIND:
        return with_others(best, likely, refined)
    if is_explained(best, refined[best], cloud.points, cloud.depth_std):
        of_any_form = with_others(best, likely, refined)
    else:
        of_any_form = box_around(frame, cloud.used, cloud.points, bottom, cloud.depth_std)
    return with_unseen_rest(of_any_form, edges.unseen_share)


def _around(frame: PreparedFrame, cloud: MaskedCloud, reach: float = 0.12) -> np.ndarray:
    """Every few points that is not the thing's and lies within `reach` [m] of it sideways, shape (m, 3)."""
    points = frame.thinned_points(without=cloud.mask)
    low, high = cloud.points[:, :2].min(0) - reach, cloud.points[:, :2].max(0) + reach
    return points[np.all((points[:, :2] > low) & (points[:, :2] < high), axis=1)]
