"""From one mask to one upright solid with a spread."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from perception.cloud import StereoNoise, depth_steps, largest_cluster, world_points
from perception.estimates import Shape
from perception.frames import RgbdFrame
from perception.outline import own_outline_share
from perception.resting import find_bottom, lower_end_is_hidden
from perception.solids import Solid, fit_box, fit_cylinder, fit_sphere
from perception.support import SupportPlane


@dataclass(frozen=True)
class PoseSettings:
    """Settings of the pose estimate.

    Attributes:
        noise: Of the depth.
        depth_step: Pixels beside a larger step are dropped, in [m].
        edge_px: How far beside a step pixels are dropped, in [px].
        least_depth_share: Below this share of a mask's pixels with known depth there is no pose.
        least_points: Below this number of usable points there is no pose.
        clearance: Points lower than this above the support may be the support's, in [m].
    """

    noise: StereoNoise = field(default_factory=StereoNoise)
    depth_step: float = 0.03
    edge_px: int = 1
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
        depth_share: Share of the mask with known depth, 0..1.
        depth_std: Spread of one point along its ray in [m].
        bottom_hidden: Whether something covers the lower end.
        free: Share of the outline that is the thing's own, 0..1.
    """

    mask: np.ndarray
    used: np.ndarray
    points: np.ndarray
    depth_share: float
    depth_std: float
    bottom_hidden: bool
    free: float

    @property
    def lowest(self) -> float:
        """Height of the lowest visible points in [m]."""
        return float(np.quantile(self.points[:, 2], 0.02))


def masked_cloud(frame: RgbdFrame, mask: np.ndarray, table: SupportPlane, settings: PoseSettings) -> MaskedCloud | str:
    """Trusted points of a mask, or the reason why there are too few."""
    size = int(mask.sum())
    if size == 0:
        return "nothing stands out inside its box"
    known = mask & frame.valid_depth
    share = float(known.sum() / size)
    if share < settings.least_depth_share:
        return f"not enough depth ({share:.0%} of its pixels, {settings.least_depth_share:.0%} are needed)"
    used = known & ~depth_steps(frame.depth, frame.valid_depth, settings.depth_step, settings.edge_px)
    if used.sum() < max(settings.least_points, 0.3 * known.sum()):
        used = known  # a thing so small or thin that all of it lies beside a step
    points = world_points(frame, used)
    keep = points[:, 2] > table.at(points[:, 0], points[:, 1]) + settings.clearance
    keep[keep] = largest_cluster(points[keep])
    used = used.copy()
    used[used] = keep
    points = points[keep]
    if len(points) < settings.least_points:
        return f"too few usable depth points ({len(points)}, {settings.least_points} are needed)"
    depth = np.where(frame.valid_depth, frame.depth, np.nan)
    distance = float(np.median(frame.depth[used]))
    return MaskedCloud(
        mask,
        used,
        points,
        share,
        settings.noise.depth_std(distance, frame.intrinsics.fx),
        lower_end_is_hidden(mask, depth),
        own_outline_share(mask, depth),
    )


def fit_solid(cloud: MaskedCloud, shape: Shape, table: SupportPlane, others: Sequence[Solid]) -> Solid:
    """First fit of a solid of the given shape that rests on the table or on one of the others."""
    bottom = find_bottom(cloud.points, cloud.bottom_hidden, table, others, cloud.depth_std)
    if shape == "sphere":
        return fit_sphere(cloud.points)
    if shape == "cylinder":
        return fit_cylinder(cloud.points, bottom, cloud.depth_std)
    return fit_box(cloud.points, bottom, cloud.depth_std)


def spread(cloud: MaskedCloud, solid: Solid, frame: RgbdFrame, noise: StereoNoise) -> tuple[np.ndarray, float]:
    """Spread of a fitted solid: position along the world's axes in [m], shape (3,), and yaw in [rad].

    Along the ray the depth noise is averaged over the patches that err independently; across it one pixel of the
    outline counts; the hidden part of the outline adds its share of half the thing's size. A yaw comes from an edge of
    length L: yaw_std = sqrt(12) s / L for an even spread s along it.
    """
    distance = float(np.linalg.norm(solid.centre - frame.world_T_camera[:3, 3]))
    patches = max(1.0, len(cloud.points) / noise.patch_px)
    along_ray = np.hypot(cloud.depth_std / np.sqrt(patches), 0.001)
    pixel = distance / frame.intrinsics.fx
    across = np.hypot(0.7 * pixel, 0.001)
    ray = (solid.centre - frame.world_T_camera[:3, 3]) / max(distance, 1e-9)
    hidden = (1.0 - cloud.free) * 0.35 * solid.extents
    size = np.abs(solid.pose[:3, :3]) @ hidden
    position = np.sqrt(along_ray**2 * ray**2 + across**2 * (1.0 - ray**2) + size**2)
    if solid.shape != "box":
        return position, float("inf")
    edge = max(float(solid.extents[:2].max()), 0.01)
    yaw = np.sqrt(12.0) * np.hypot(across, along_ray) / edge / 2.0 * (1.0 + 3.0 * (1.0 - cloud.free))
    return position, float(min(yaw, np.pi / 4))
