"""What the motion search needs to know of a digital twin. Built by `sim_check`, from perception alone."""

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.robot.gripper import PANDA_HAND, GripperModel
from control.seen_volume import SeenVolume

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
class Handle:
    """A straight bar to take hold of: of a door, a lever's knob, a kettle's handle.

    Everything is in the frame of the body that it belongs to (a door's own moving frame, a kettle's body frame).

    Attributes:
        body: Name of its MuJoCo body.
        shape: "capsule" (round: any direction across the axis does) or "box".
        centre: Middle of the graspable part in [m], shape (3,).
        axis: Unit vector along the bar, shape (3,).
        outward: Unit vector away from what it is fastened to, normal to the axis, shape (3,): fingers come from there.
        half_length: Half of the graspable length in [m]; stand-offs are left out.
        half_width: Half of its thickness across axis and outward in [m].
        half_depth: Half of its thickness along outward in [m].
        clearance: Free depth between its back and what it is fastened to in [m]; infinite when there is nothing.
    """

    body: str
    shape: Literal["capsule", "box"]
    centre: NDArray[np.float64]
    axis: NDArray[np.float64]
    outward: NDArray[np.float64]
    half_length: float
    half_width: float
    half_depth: float
    clearance: float


@dataclass(frozen=True)
class TwinJoint:
    """One joint of furniture that a robot can move: a door, a lever.

    Axis and anchor in the world are `MjData.xaxis` and `MjData.xanchor` of the MuJoCo joint of the same name.

    Attributes:
        name: Name of the joint, of its MuJoCo joint and of its moving MuJoCo body alike.
        body: Name of the moving body.
        owner: Furniture that it belongs to: the name of a `TwinObject` and of its fixed body.
        kind: Whether it turns ([rad]) or slides ([m]).
        closed, opened: Joint positions at fraction 0 and 1, in [rad] or [m].
        axis: Unit vector of the joint in the moving body's frame, shape (3,): the moving body turns by the right-hand
            rule about it, or slides along it, as the joint position grows.
        anchor: A point on the joint's axis in the moving body's frame in [m], shape (3,).
        handle: What to take hold of, in the moving body's frame.
    """

    name: str
    body: str
    owner: str
    kind: Literal["hinge", "slide"]
    closed: float
    opened: float
    axis: NDArray[np.float64]
    anchor: NDArray[np.float64]
    handle: Handle

    def position(self, fraction: float) -> float:
        """Joint position in [rad] or [m] at a fraction, 0 closed .. 1 open."""
        return self.closed + fraction * (self.opened - self.closed)

    def fraction(self, position: float) -> float:
        """Fraction, 0 closed .. 1 open, of a joint position in [rad] or [m]; not cut at the ends."""
        return (position - self.closed) / (self.opened - self.closed)


@dataclass(frozen=True)
class TwinCompartment:
    """The inside of furniture, where things can be put.

    Attributes:
        owner: Furniture that it belongs to; its corners are in that body's frame.
        low, high: Corners of the free inside in [m], shape (3,): low's z is the shelf's surface.
        outward: Unit vector from the inside through the opening, in the owner's frame, shape (3,).
        joints: Joints whose doors close it; any that covers the place in question must be open.
    """

    owner: str
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    outward: NDArray[np.float64]
    joints: tuple[str, ...]


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
        handle: What to take hold of when the whole is too wide for the gripper (a kettle), or None.
        doubts: What speaks against it as perceived, a clause each; a doubted thing is not taken hold of.
        named: Whether somebody named it; otherwise it is a box around depth that nothing explains.
    """

    name: str
    shape: Literal["box", "cylinder", "sphere"]
    extents: NDArray[np.float64]
    movable: bool
    container: bool
    inner_floor: float
    inner_radius: float
    position_std: NDArray[np.float64]
    yaw_std: float
    handle: Handle | None = None
    doubts: tuple[str, ...] = ()
    named: bool = True


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
        joints: Joints of furniture that a robot can move; the furniture itself is among `objects`, not movable.
        compartments: Insides of furniture.
        gripper: What the hand is.
        seen: Which space cameras have looked into; None where no camera has looked.
    """

    model: mujoco.MjModel
    qpos: NDArray[np.float64]
    q: NDArray[np.float64]
    gripper_width: float
    held: str | None
    objects: tuple[TwinObject, ...]
    support_height: float
    scene_stamp: float
    joints: tuple[TwinJoint, ...] = ()
    compartments: tuple[TwinCompartment, ...] = ()
    gripper: GripperModel = PANDA_HAND
    seen: SeenVolume | None = None

    def get(self, name: str) -> TwinObject | None:
        """The object of this name, or None."""
        return next((o for o in self.objects if o.name == name), None)

    def joint(self, name: str) -> TwinJoint | None:
        """The furniture joint of this name, or None."""
        return next((j for j in self.joints if j.name == name), None)

    def joint_fractions(self, qpos: np.ndarray | None = None) -> dict[str, float]:
        """Fraction of every furniture joint, 0 closed .. 1 open.

        Args:
            qpos: Configuration, shape (nq,); the start's if None.
        """
        state = self.qpos if qpos is None else qpos
        return {j.name: j.fraction(float(state[self.model.joint(j.name).qposadr[0]])) for j in self.joints}

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
