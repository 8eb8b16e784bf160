"""What of a solid a camera sees as its outline, and how far pixels are from it."""

import cv2
import numpy as np

from perception.frames import RgbdFrame
from perception.geometry.solids import Solid


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


def project(points: np.ndarray, frame: RgbdFrame) -> np.ndarray:
    """Where points of the world in [m], shape (n, 3), are in a picture in [px], shape (n, 2)."""
    pose, k = frame.world_T_camera, frame.intrinsics
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    z = np.maximum(local[:, 2], 0.02)
    return np.stack([k.fx * local[:, 0] / z + k.cx, k.fy * local[:, 1] / z + k.cy], -1)
