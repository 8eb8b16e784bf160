"""Frames that hang on each other, as ROS publishes them: poses of one frame in another at any moment.

A transform (parent, child, stamp) is  parent_T_child.  The pose of a camera in the world is the product down the chain
of parents, each interpolated at the moment asked for: positions linearly, rotations by slerp.
"""

from array import array
from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from perception.errors import FrameError

REACH = 0.1  # [s] around a transform in which it holds by itself, at either end of all and at a gap
GAP = 0.5  # [s] without a transform, over which something that moved meanwhile is not interpolated
STILL = 1e-6  # [m] and quaternion components; transforms that differ less are the same
ROW = 8  # stamp [s], position [m], quaternion x y z w


class TransformTree:
    """Transforms by child frame. Fill it with `add`, then ask."""

    def __init__(self) -> None:
        self._parents: dict[str, str] = {}
        self._rows: dict[str, array] = {}
        self._static: set[str] = set()
        self._tables: dict[str, np.ndarray] = {}  # rows in the order of time, made when they are asked for

    def add(self, transforms: Iterable[Any], static: bool) -> str:
        """Take in the transforms of a tf2_msgs/TFMessage.

        Args:
            transforms: geometry_msgs/TransformStamped.
            static: Whether they hold for all times (topic /tf_static).

        Returns:
            What was wrong with one of them, which was left out; empty where nothing was.
        """
        wrong = ""
        for t in transforms:
            parent, child = t.header.frame_id.lstrip("/"), t.child_frame_id.lstrip("/")
            p, r = t.transform.translation, t.transform.rotation
            row = np.array(
                [(t.header.stamp.sec * 10**9 + t.header.stamp.nanosec) / 1e9, p.x, p.y, p.z, r.x, r.y, r.z, r.w]
            )
            length = float(np.linalg.norm(row[4:]))
            if not np.isfinite(row).all() or abs(length - 1.0) > 0.01 or not parent or not child:
                wrong = f"the transform from '{parent}' to '{child}' is none: {np.round(row[1:], 6).tolist()}"
                continue
            row[4:] /= length
            self._parents[child] = parent
            self._append(child, row)
            if static:
                self._static.add(child)
        return wrong

    def _append(self, child: str, row: np.ndarray) -> None:
        """Add a row; of a frame at rest only the first and the last are kept."""
        rows = self._rows.setdefault(child, array("d"))
        self._tables.pop(child, None)
        if len(rows) >= 2 * ROW:
            first, last = np.array(rows[-2 * ROW :]).reshape(2, ROW)[:, 1:]
            row[4:] *= 1.0 if row[4:] @ last[3:] >= 0.0 else -1.0  # a quaternion and its negative turn alike
            if max(np.abs(first - last).max(), np.abs(first - row[1:]).max()) < STILL:
                del rows[-ROW:]
        rows.extend(row)

    def ancestors(self, frame: str) -> list[str]:
        """Frames above a frame, the nearest first."""
        chain, frame = [], frame.lstrip("/")
        while frame in self._parents and self._parents[frame] not in chain:
            frame = self._parents[frame]
            chain.append(frame)
        return chain

    def pose(self, root: str, frame: str, stamp: float) -> np.ndarray:
        """root_T_frame at a moment, shape (4, 4).

        Args:
            root: The frame itself or one of its ancestors.
            frame: Which frame.
            stamp: When, in [s].

        Raises:
            FrameError: The root is none of its ancestors, or there is no transform at that time.
        """
        root, frame = root.lstrip("/"), frame.lstrip("/")
        chain = [frame, *self.ancestors(frame)]
        if root not in chain:
            raise FrameError(f"no transform leads from '{root}' to '{frame}'; above it are {chain[1:] or 'none'}")
        pose = np.eye(4)
        for child in chain[: chain.index(root)]:
            pose = self._at(child, stamp) @ pose
        return pose

    def _at(self, child: str, stamp: float) -> np.ndarray:
        """parent_T_child at a moment, shape (4, 4)."""
        rows = self._tables.get(child)
        if rows is None:
            rows = np.array(self._rows[child]).reshape(-1, ROW)
            rows = self._tables[child] = rows[np.argsort(rows[:, 0], kind="stable")]
        if child in self._static or np.ptp(rows[:, 1:], axis=0).max() < STILL:
            return _matrix(rows[-1, 1:4], Rotation.from_quat(rows[-1, 4:]))
        times = rows[:, 0]
        k = int(np.searchsorted(times, stamp))
        before, after = rows[max(k - 1, 0)], rows[min(k, len(rows) - 1)]
        outside = k in (0, len(times))
        if outside or (after[0] - before[0] > GAP and np.abs(after[1:] - before[1:]).max() > STILL):
            near = before if abs(before[0] - stamp) < abs(after[0] - stamp) else after
            if abs(near[0] - stamp) > REACH:
                they = f"go from {times[0]:.3f} to {times[-1]:.3f} s" if outside else f"jump from {before[0]:.3f} s on"
                raise FrameError(
                    f"no transform of '{child}' within {REACH:g} s of the picture at {stamp:.3f} s: they {they}"
                )
            return _matrix(near[1:4], Rotation.from_quat(near[4:]))
        share = (stamp - before[0]) / (after[0] - before[0])
        turned = Slerp([0.0, 1.0], Rotation.from_quat([before[4:], after[4:]]))(share)
        return _matrix((1 - share) * before[1:4] + share * after[1:4], turned)


def _matrix(position: np.ndarray, rotation: Rotation) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.as_matrix(), position
    return pose
