"""Where the robot is in space: points on its surface over time, held against the workspace box and keep-out zones.

The hand (hand, fingers, tool centre point) must stay in the box; every moving part of the arm must stay out of the
zones, elbow and forearm too. A part is known by points with a radius: ends and middle of a capsule, corners of a box.

    outside(t) = max over the hand's points of |max(low - (p - r), 0) + max((p + r) - high, 0)|
    inside(t)  = max over all points and zones of r - signed distance of p from the zone
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY, TCP_SITE

_HAND = frozenset({HAND_BODY, *FINGER_BODIES})


@dataclass(frozen=True)
class RobotTrack:
    """Points of the robot over time.

    Attributes:
        bodies: Name of the body that each point belongs to, k names.
        radius: Of the sphere around each point in [m], shape (k,).
        points: In the world in [m], shape (n, k, 3).
    """

    bodies: tuple[str, ...]
    radius: NDArray[np.float64]
    points: NDArray[np.float64]

    @classmethod
    def of_hand(cls, tcp: np.ndarray) -> "RobotTrack":
        """The tool centre point alone, from its poses (n, 4, 4)."""
        return cls((HAND_BODY,), np.zeros(1), tcp[:, None, :3, 3])


class RobotPoints:
    """Reads the points of a model's moving links, hand and fingers.

    Args:
        model: Of a twin.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        owners = {model.body(name).id: name for name in (*ARM_BODIES[1:], HAND_BODY, *FINGER_BODIES)}
        local, radius, bodies = [], [], []
        self._spans: list[tuple[int, slice]] = []  # points of each geom
        for geom in range(model.ngeom):
            body = int(model.geom_bodyid[geom])
            if body not in owners or not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
                continue
            points, around = _points(model, geom)
            self._spans.append((geom, slice(len(local), len(local) + len(points))))
            local += points
            radius += [around] * len(points)
            bodies += [owners[body]] * len(points)
        self._local = np.array(local).reshape(-1, 3)
        self._site = model.site(TCP_SITE).id
        self.bodies = (*bodies, HAND_BODY)
        self.radius = np.array([*radius, 0.0])

    def at(self, data: mujoco.MjData) -> np.ndarray:
        """Points in the world in [m], shape (k, 3); kinematics must be up to date."""
        return self.along(data.geom_xpos[None], data.geom_xmat[None], data.site_xpos[None])[0]

    def along(self, geom_xpos: np.ndarray, geom_xmat: np.ndarray, site_xpos: np.ndarray) -> np.ndarray:
        """Points in the world in [m], shape (n, k, 3), from n rows of these fields of `mujoco.MjData`."""
        # By coordinate, point and row, so that all rows of a point lie together: several times as fast.
        out = np.empty((3, len(self.bodies), len(geom_xpos)))
        for geom, points in self._spans:
            rotation = np.ascontiguousarray(geom_xmat[:, geom].T).reshape(3, 3, -1)
            for axis in range(3):
                np.matmul(self._local[points], rotation[axis], out=out[axis, points])
                out[axis, points] += geom_xpos[:, geom, axis]
        out[:, -1] = site_xpos[:, self._site].T
        return out.transpose(2, 1, 0)


def outside_box(track: RobotTrack, low: np.ndarray, high: np.ndarray) -> tuple[float, int, str]:
    """How far the hand is outside a box at most in [m] (0 inside), at which sample, and with which body."""
    rows = np.flatnonzero([b in _HAND for b in track.bodies])
    r = track.radius[rows, None]
    # The extremes of each point over time say whether it leaves the box at all, which is rare.
    lowest, highest = track.points.min(axis=0)[rows] - r, track.points.max(axis=0)[rows] + r
    if (lowest >= low).all() and (highest <= high).all():
        return 0.0, 0, track.bodies[rows[0]]
    p = track.points[:, rows]
    below, above = low - (p - r), p + r - high
    return _most(np.linalg.norm(np.maximum(below, 0.0) + np.maximum(above, 0.0), axis=2), track, rows)


def inside_zone(track: RobotTrack, low: np.ndarray, high: np.ndarray) -> tuple[float, int, str]:
    """How deep any part is inside a zone at most in [m] (0 outside), at which sample, and with which body."""
    beyond = np.maximum(low - track.points, track.points - high)  # by axis, negative inside
    distance = np.linalg.norm(np.maximum(beyond, 0.0), axis=2) + np.minimum(beyond.max(axis=2), 0.0)
    return _most(np.maximum(track.radius - distance, 0.0), track, np.arange(len(track.bodies)))


def _most(values: np.ndarray, track: RobotTrack, rows: np.ndarray) -> tuple[float, int, str]:
    sample, point = np.unravel_index(int(np.argmax(values)), values.shape)
    return float(values[sample, point]), int(sample), track.bodies[rows[point]]


def _points(model: mujoco.MjModel, geom: int) -> tuple[list[np.ndarray], float]:
    """Points of a geom in its own frame in [m], and the radius around each."""
    size, kind = model.geom_size[geom], model.geom_type[geom]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return [np.array([0.0, 0.0, z * size[1]]) for z in (-1.0, 0.0, 1.0)], float(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        corners = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)
        return list(corners * size), 0.0
    return [np.zeros(3)], float(model.geom_rbound[geom])
