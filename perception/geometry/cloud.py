"""Depth pictures to points in the world: their noise, back-projection, outliers."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from perception.frames import CameraIntrinsics


@dataclass(frozen=True)
class StereoNoise:
    """How far off the depth of a small stereo camera is.

        sigma_z(z) = z^2 * disparity_std / (focal_px * baseline)

    Defaults are those of a ZED Mini; neighbouring pixels share their error over about `patch_px` pixels because stereo
    matching compares windows.

    Attributes:
        disparity_std: Spread of the disparity in [px].
        baseline: Distance between the two eyes in [m].
        patch_px: Number of neighbouring pixels that share one error.
    """

    disparity_std: float = 0.25
    baseline: float = 0.063
    patch_px: float = 100.0

    def depth_std(self, depth: float, focal_px: float) -> float:
        """sigma_z in [m] at the given distance in [m] through a lens of the given focal length in [px]."""
        return depth**2 * self.disparity_std / (focal_px * self.baseline)


def back_project(depth: np.ndarray, intrinsics: CameraIntrinsics) -> np.ndarray:
    """Points of all pixels in the camera's optical frame in [m], shape (height, width, 3).

        p = ((u - cx) z / fx, (v - cy) z / fy, z)

    Args:
        depth: In [m], NaN where unknown, shape (height, width); rows v and columns u.
        intrinsics: Of the picture.
    """
    z = depth.astype(float)
    x = (np.arange(intrinsics.width) - intrinsics.cx) * z / intrinsics.fx
    y = (np.arange(intrinsics.height) - intrinsics.cy)[:, None] * z / intrinsics.fy
    return np.stack([x, y, z], -1)


def to_world(points: np.ndarray, world_T_camera: np.ndarray) -> np.ndarray:
    """Points of the camera's frame in the world, both in [m], shape (n, 3)."""
    return points @ world_T_camera[:3, :3].T + world_T_camera[:3, 3]


def height_map(depth: np.ndarray, intrinsics: CameraIntrinsics, world_T_camera: np.ndarray) -> np.ndarray:
    """Height of every pixel above the world's z = 0 in [m], shape (height, width).

    Args:
        depth: In [m], NaN where unknown, shape (height, width).
        intrinsics: Of the picture.
        world_T_camera: Pose of the optical frame, shape (4, 4).
    """
    k, pose = intrinsics, world_T_camera
    slope_u = pose[2, 0] * (np.arange(k.width) - k.cx) / k.fx
    slope_v = pose[2, 1] * (np.arange(k.height) - k.cy) / k.fy
    return depth * (slope_u[None, :] + slope_v[:, None] + pose[2, 2]) + pose[2, 3]


def largest_cluster(points: np.ndarray, cell: float = 0.012) -> np.ndarray:
    """Which points belong to the largest connected cluster, bool, shape (n,).

    Two points are connected when their cells of a cubic grid of side `cell` [m] touch (26 neighbours).
    """
    if len(points) == 0:
        return np.zeros(0, bool)
    index = np.floor((points - points.min(0)) / cell).astype(int)
    shape = index.max(0) + 1
    if np.prod(shape.astype(float)) > 5e7:  # points all over the place: a grid would not fit into memory
        near = np.linalg.norm(points - np.median(points, 0), axis=1) < 1.0
        inside = np.zeros(len(points), bool)
        inside[near] = largest_cluster(points[near], cell) if near.sum() < len(points) else True
        return inside
    grid = np.zeros(shape, bool)
    grid[tuple(index.T)] = True
    labels, count = ndimage.label(grid, np.ones((3, 3, 3)))  # type: ignore
    of_point = labels[tuple(index.T)]
    return of_point == np.argmax(np.bincount(of_point, minlength=count + 1)[1:]) + 1
