"""What the motion search needs to know of a digital twin. Built by `sim_check`, from perception alone."""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

# Names that every MuJoCo model of ours uses for the robot (the twin's and the simulated cell's alike).
ARM_JOINTS = tuple(f"panda_joint{i}" for i in range(1, 8))
FINGER_JOINTS = ("panda_finger_joint1", "panda_finger_joint2")
ARM_BODIES = tuple(f"panda_link{i}" for i in range(8))
HAND_BODY = "panda_hand"
FINGER_BODIES = ("panda_leftfinger", "panda_rightfinger")
TCP_SITE = "tcp"
ARM_ACTUATORS = ARM_JOINTS  # position servos with velocity damping; ctrl = joint position in [rad]
# Position servo of the mean finger position; ctrl = half of the width between the pads in [m].
GRIPPER_ACTUATOR = "gripper"
TABLE_BODY = "table"


@dataclass(frozen=True)
class TwinObject:
    """One thing in the twin, apart from robot and table.

    Attributes:
        name: Scene name, also the name of its MuJoCo body.
        shape: Solid that perception fitted.
        extents: Full sizes along the object's own axes in [m], shape (3,).
        movable: Whether it is a free body (and so could be grasped or pushed).
        container: Whether things are put into it instead of onto it (a bowl).
        inner_floor: Height of a container's inner floor above the object's lowest point in [m], else 0.
        inner_radius: Radius of a container's opening in [m], else 0.
        position_std: Spread of its position as perceived, in [m], shape (3,).
        yaw_std: Spread of its yaw in [rad]; infinite where it has none.
    """

    name: str
    shape: Literal["box", "cylinder", "sphere"]
    extents: np.ndarray
    movable: bool
    container: bool
    inner_floor: float
    inner_radius: float
    position_std: np.ndarray
    yaw_std: float


@dataclass(frozen=True)
class TwinModel:
    """A MuJoCo model with a settled start state and the names to read it by.

    Attributes:
        model: Compiled at the search step (4 ms); a judge may change its time step on a copy.
        qpos: Start configuration, shape (nq,).
        q: Start arm joints in [rad], shape (7,): what the robot is commanded to hold.
        gripper_width: Start distance between the pads in [m].
        held: Name of the object in the hand at the start, or None.
        objects: Everything that was perceived.
        support_height: Height of the table top in [m].
        scene_stamp: Time of the frame that it was built from in [s].
    """

    model: mujoco.MjModel
    qpos: np.ndarray
    q: np.ndarray
    gripper_width: float
    held: str | None
    objects: tuple[TwinObject, ...]
    support_height: float
    scene_stamp: float

    def get(self, name: str) -> TwinObject | None:
        """The object of this name, or None."""
        return next((o for o in self.objects if o.name == name), None)

    def start(self) -> mujoco.MjData:
        """Fresh data in the start state, with controls that hold it, forwarded."""
        data = mujoco.MjData(self.model)
        data.qpos[:] = self.qpos
        for name, value in zip(ARM_ACTUATORS, self.q, strict=True):
            data.ctrl[self.model.actuator(name).id] = value
        # A held object keeps the pads apart; the servo keeps squeezing it.
        width = 0.0 if self.held else self.gripper_width
        data.ctrl[self.model.actuator(GRIPPER_ACTUATOR).id] = width / 2
        mujoco.mj_forward(self.model, data)
        return data
