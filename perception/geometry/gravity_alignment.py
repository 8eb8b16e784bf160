"""Where is up: a world for cameras whose pose nobody wrote down, from the plane that things stand on."""

import numpy as np

from perception.errors import FrameError
from perception.frames import CameraIntrinsics
from perception.geometry.cloud import back_project

MOST_SAMPLES = 6000


def camera_above_plane(
    depth: np.ndarray, intrinsics: CameraIntrinsics, seed: int = 0, inlier: float = 0.008, tries: int = 300
) -> np.ndarray:
    """Pose of a camera in a world whose z = 0 is the largest plane that could carry things, and whose z is up.

    The world's origin lies where the optical axis meets the plane and its x axis points away from the camera. Planes
    whose normal points less than 15 degrees towards the upper edge of the picture and less than 15 degrees towards
    the camera are taken for walls.

    Args:
        depth: In [m], NaN where unknown, shape (height, width).
        intrinsics: Of the picture.
        seed: Of the random triples of points.
        inlier: Half thickness of the plane at 1 m in [m]; grows with the square of the distance.
        tries: Number of triples.

    Returns:
        world_T_camera, shape (4, 4).

    Raises:
        FrameError: No plane holds a tenth of the known depths.
    """
    grid = np.zeros(depth.shape, bool)
    stride = max(1, round(np.sqrt(depth.size / MOST_SAMPLES)))
    grid[::stride, ::stride] = True
    points = back_project(depth, intrinsics)[grid & np.isfinite(depth) & (depth > 0)]
    if len(points) < 100:
        raise FrameError(
            f"only {len(points)} depth samples are known: too few to find the plane that things stand on; "
            "give world_T_camera with the recording"
        )
    rng = np.random.default_rng(seed)
    tolerance = inlier * np.maximum(points[:, 2], 0.5) ** 2
    up, offset, most = np.zeros(3), 0.0, 0
    for triple in rng.integers(0, len(points), (tries, 3)):
        a, b, c = points[triple]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length < 1e-6:
            continue
        normal = normal / length * (1.0 if normal @ a < 0 else -1.0)  # towards the camera
        if -normal[1] < 0.25 and -normal[2] < 0.25:
            continue
        count = int((np.abs((points - a) @ normal) < tolerance).sum())
        if count > most and -normal[1] > -0.2:
            up, offset, most = normal, float(normal @ a), count
    if most < 0.1 * len(points):
        raise FrameError(
            f"no plane holds a tenth of the known depths (the largest {most} of {len(points)} samples); "
            "give world_T_camera with the recording"
        )
    for _ in range(3):
        chosen = points[np.abs(points @ up - offset) < tolerance]
        middle = chosen.mean(0)
        normal = np.linalg.svd(chosen - middle, full_matrices=False)[2][2]
        up = normal * np.sign(normal @ up)
        offset = float(up @ middle)
    pose = np.eye(4)
    away = np.array([0.0, 0.0, 1.0]) - up[2] * up
    if np.linalg.norm(away) < 0.05:  # straight down: away is the upper edge of the picture
        away = np.array([0.0, -1.0, 0.0]) - (-up[1]) * up
    away /= np.linalg.norm(away)
    pose[:3, :3] = np.stack([away, np.cross(up, away), up])
    depth_on_axis = offset / up[2] if abs(up[2]) > 0.1 else 1.0
    origin = np.array([0.0, 0.0, depth_on_axis])
    origin = origin - (up @ origin - offset) * up
    pose[:3, 3] = -pose[:3, :3] @ origin
    return pose
