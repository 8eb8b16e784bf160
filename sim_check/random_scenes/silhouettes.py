"""How many pixels a thing would cover with nothing in front of it: the hull of its projected body."""

from collections.abc import Iterator, Mapping

import cv2
import mujoco
import numpy as np

from perception.frames import CameraIntrinsics
from sim_check.furniture.model import FurnitureModel
from sim_check.objects.library import ObjectModel
from sim_check.objects.solids import SolidShape

_TURNS = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_RING = np.stack([np.cos(_TURNS), np.sin(_TURNS), np.zeros(12)], -1)
_ROUND = np.concatenate(
    [np.c_[np.cos(a) * _RING[:, :2], np.full(12, np.sin(a))] for a in np.radians([-90, -60, -30, 0, 30, 60, 90])]
)
_UP = np.array([0.0, 0.0, 1.0])
_CAN = np.concatenate([_RING - _UP, _RING + _UP])
NEAREST = 0.02  # points nearer to the camera are moved to this depth, in [m]


def silhouette_area(
    model: ObjectModel | FurnitureModel,
    pose: np.ndarray,
    fractions: Mapping[str, float],
    lens: CameraIntrinsics,
    world_T_camera: np.ndarray,
) -> float:
    """Area of a thing's silhouette in [px], the picture's edges left aside.

    It is the area of the convex hull of its body; of furniture the largest of the hulls of body and doors. Things with
    dents (a kettle's handle, a microwave with its door open) cover somewhat less.

    Args:
        model: The thing.
        pose: world_T_object, shape (4, 4).
        fractions: How far its parts are open, 0..1, by name.
        lens: Intrinsics.
        world_T_camera: Optical frame, shape (4, 4).
    """
    if isinstance(model, ObjectModel):
        groups = [np.concatenate(list(_points(model.solids)))]
    else:
        groups = [np.concatenate(list(_points(b.solid for b in model.boards if b.look != "hidden")))]
        for part in model.parts:
            own = np.concatenate(list(_points(b.solid for b in part.boards if b.look != "hidden")))
            turn, shift = _moved(part.kind, part.axis, fractions.get(part.name, 0.0) * part.opened)
            groups.append(own @ turn.T + shift + part.anchor)
    area = 0.0
    for points in groups:
        world = points @ pose[:3, :3].T + pose[:3, 3]
        local = (world - world_T_camera[:3, 3]) @ world_T_camera[:3, :3]
        z = np.maximum(local[:, 2], NEAREST)
        flat = np.stack([lens.fx * local[:, 0] / z + lens.cx, lens.fy * local[:, 1] / z + lens.cy], -1)
        area = max(area, float(cv2.contourArea(cv2.convexHull(flat.astype(np.float32)))))
    return area


def _points(solids) -> Iterator[np.ndarray]:
    """Points of each solid's surface in the frame of its body, shape (n, 3)."""
    for solid in solids:
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, np.asarray(solid.quat, float))
        yield _surface(solid) @ turn.reshape(3, 3).T + solid.position


def _surface(solid: SolidShape) -> np.ndarray:
    if solid.kind == "box":
        return _CORNERS * solid.half
    if solid.kind == "cylinder":
        return _CAN * solid.half
    if solid.kind == "capsule":
        return np.concatenate([_ROUND * solid.half[0] + [0, 0, side * solid.half[2]] for side in (-1, 1)])
    return _ROUND * solid.half


def _moved(kind: str, axis: np.ndarray, position: float) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and shift of a part at a joint position."""
    if kind == "slide":
        return np.eye(3), axis * position
    quat, turn = np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(quat, np.asarray(axis, float), position)
    mujoco.mju_quat2Mat(turn, quat)
    return turn.reshape(3, 3), np.zeros(3)
