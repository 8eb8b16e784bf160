"""Where doors swing: places on the table where a thing would be in the way of a door or of the hand that opens it."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.twin_model import TwinModel

HAND_ROOM = 0.10  # [m] beyond the handle for the hand that drives it: half of a Panda hand's width of 0.2
SPARE_ANGLE = 0.3  # [rad] on either side of the door's way
UPRIGHT = 0.9  # vertical part of a hinge's axis that swings over the table


@dataclass(frozen=True)
class Swing:
    """The sector that a hinged door and the hand at its handle sweep, seen from above.

    Attributes:
        owner: Furniture that the door belongs to.
        centre: Of the hinge in the world in [m], shape (2,).
        radius: From the hinge to beyond the hand in [m].
        middle: Direction of the sector's middle in [rad], from the world's x.
        half_angle: Half of the sector in [rad].
    """

    owner: str
    centre: NDArray[np.float64]
    radius: float
    middle: float
    half_angle: float

    def reaches(self, points: np.ndarray, size: float) -> np.ndarray:
        """Which round things of a radius `size` [m] at points (n, 2) [m] stand in it, bool, shape (n,)."""
        offset = np.asarray(points)[:, :2] - self.centre
        distance = np.linalg.norm(offset, axis=1)
        turn = np.arctan2(offset[:, 1], offset[:, 0]) - self.middle
        turn = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
        # A thing beside the sector reaches into it as far as it is wide.
        beside = np.arcsin(np.clip(size / np.maximum(distance, size), 0.0, 1.0))
        return (distance < self.radius + size) & (turn < self.half_angle + beside)


def door_swings(twin: TwinModel) -> list[Swing]:
    """Sectors of all doors of a twin that turn about upright hinges.

    Args:
        twin: With its furniture where it stands.
    """
    data = mujoco.MjData(twin.model)
    data.qpos[:] = twin.qpos
    for joint in twin.joints:
        data.qpos[twin.model.joint(joint.name).qposadr[0]] = joint.closed
    mujoco.mj_kinematics(twin.model, data)
    found = []
    for joint in twin.joints:
        body = data.body(joint.body)
        rotation = body.xmat.reshape(3, 3)
        axis = rotation @ joint.axis
        if joint.kind != "hinge" or abs(axis[2]) < UPRIGHT:
            continue
        hinge = body.xpos + rotation @ joint.anchor
        arm = (body.xpos + rotation @ joint.handle.centre - hinge)[:2]
        way = (joint.opened - joint.closed) * np.sign(axis[2])
        found.append(
            Swing(
                joint.owner,
                hinge[:2],
                float(np.linalg.norm(arm)) + HAND_ROOM,
                float(np.arctan2(arm[1], arm[0]) + way / 2),
                abs(way) / 2 + SPARE_ANGLE,
            )
        )
    return found
