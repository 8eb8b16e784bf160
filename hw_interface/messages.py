"""Every message between a cell and the rest. SI units; joint arrays in the order of `control.limits.JOINT_NAMES`.

State, frames and results come out of a cell; trajectories, stop and acknowledge requests go in. All times are on the
robot process's wall clock in [s] since 1970.
"""

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from control.certificate import Certificate
from control.errors import TrajectoryError
from control.limits import JOINT_NAMES
from control.trajectory import GripperCommand, GripperEvent, Trajectory, TrajectorySegment
from hw_interface.errors import MessageError
from hw_interface.wire import Message, array_field
from perception.errors import FrameError
from perception.frames import CameraIntrinsics, RgbdFrame

MAX_SAMPLES = 180_000  # three minutes at 1 kHz
Mode = Literal["idle", "moving", "stopping", "stopped", "reflex"]
Name = Annotated[str, Field(min_length=1, max_length=64)]
Text = Annotated[str, Field(max_length=2000)]
Joints = Annotated[tuple[float, ...], Field(min_length=len(JOINT_NAMES), max_length=len(JOINT_NAMES))]
JointRows = array_field("<f8", (None, len(JOINT_NAMES)))


class Trouble(Message):
    """Why the robot stopped by itself.

    Attributes:
        code: tracking_error, lost_grasp, gripper_late, contact, frozen or internal_error.
        reason: For people: what was measured, the limit, what to do.
    """

    type_name: ClassVar[str] = "trouble"
    code: Name
    reason: Text


class RobotState(Message):
    """What the robot measures and does.

    Attributes:
        stamp: When it was measured in [s].
        epoch: Identity of this run of the robot process; another epoch means that it was restarted.
        mode: idle (ready); moving; stopping (coming to rest on its path); stopped (on request) or reflex (by itself),
            both until acknowledged.
        q, qd: Measured joint positions in [rad] and velocities in [rad/s].
        q_d: Joint positions that the robot is commanded to hold or pass in [rad]; new motions begin here.
        tau: Measured joint torques in [Nm].
        gripper_width: Measured distance between the pads in [m].
        grasped: Whether the gripper holds something.
        motion_serial: Certificate of the current or latest motion, or None.
        progress, samples: Samples played and samples in the motion.
        tracking_error: Largest difference per joint between commanded and measured position right now in [rad].
        cell, profile: Names of the cell and of the robot profile.
        limits_hash: Hash of the safety and robot limits that certificates must carry.
        last_error: Why the mode is `reflex`, else None.
    """

    type_name: ClassVar[str] = "robot_state"
    stamp: float
    epoch: Name
    mode: Mode
    q: Joints
    qd: Joints
    q_d: Joints
    tau: Joints
    gripper_width: float
    grasped: bool
    motion_serial: Name | None
    progress: int
    samples: int
    tracking_error: float
    cell: Name
    profile: Name
    limits_hash: Name
    last_error: Trouble | None


class CellInfo(Message):
    """What a cell offers.

    Attributes:
        epoch: As in RobotState.
        cell, profile, limits_hash: As in RobotState.
        cameras: Names to ask frames of.
        max_scene_age: Oldest frame in [s] that a motion may have been judged on.
        scored: Whether the key `truth` exists (simulated cells started for a benchmark only).
    """

    type_name: ClassVar[str] = "cell_info"
    epoch: Name
    cell: Name
    profile: Name
    limits_hash: Name
    cameras: tuple[Name, ...]
    max_scene_age: float
    scored: bool


class InfoRequest(Message):
    """Asks for CellInfo."""

    type_name: ClassVar[str] = "info_request"


class StateRequest(Message):
    """Asks for a RobotState measured now."""

    type_name: ClassVar[str] = "state_request"


class FrameRequest(Message):
    """Asks for a picture taken now."""

    type_name: ClassVar[str] = "frame_request"


class FrameMessage(Message):
    """One RGB-D frame; the fields are those of `perception.frames.RgbdFrame`."""

    type_name: ClassVar[str] = "frame"
    camera: Name
    stamp: float
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    colour: array_field("|u1", (None, None, 3))  # type: ignore[valid-type]
    depth: array_field("<f4", (None, None), finite=False)  # type: ignore[valid-type]
    world_T_camera: array_field("<f8", (4, 4))  # type: ignore[valid-type]

    @classmethod
    def of(cls, frame: RgbdFrame) -> "FrameMessage":
        """The message of a frame."""
        k = frame.intrinsics
        return cls(
            camera=frame.camera,
            stamp=float(frame.stamp),
            width=int(k.width),
            height=int(k.height),
            fx=float(k.fx),
            fy=float(k.fy),
            cx=float(k.cx),
            cy=float(k.cy),
            colour=frame.colour,
            depth=np.asarray(frame.depth, "<f4"),
            world_T_camera=np.asarray(frame.world_T_camera, "<f8"),
        )

    def frame(self) -> RgbdFrame:
        """The frame in this message.

        Raises:
            MessageError: Sizes disagree or the pose is not rigid.
        """
        try:
            intrinsics = CameraIntrinsics(self.width, self.height, self.fx, self.fy, self.cx, self.cy)
            return RgbdFrame(self.colour, self.depth, intrinsics, self.world_T_camera, self.stamp, self.camera)
        except FrameError as error:
            raise MessageError("frame", str(error)) from error


class GripperEventMessage(Message):
    """`control.trajectory.GripperEvent` with its command."""

    type_name: ClassVar[str] = "gripper_event"
    time: Annotated[float, Field(ge=0)]
    dwell: Annotated[float, Field(ge=0)]
    kind: Literal["move", "grasp"]
    width: Annotated[float, Field(ge=0)]
    force: Annotated[float, Field(ge=0)]


class SegmentMessage(Message):
    """`control.trajectory.TrajectorySegment`."""

    type_name: ClassVar[str] = "segment"
    name: Name
    start: Annotated[int, Field(ge=0)]
    stop: Annotated[int, Field(ge=0)]
    held: Name | None
    touching: Annotated[tuple[tuple[Name, Name], ...], Field(max_length=1000)]


class CertificateMessage(Message):
    """`control.certificate.Certificate`."""

    type_name: ClassVar[str] = "certificate"
    serial: Name
    trajectory_hash: Name
    profile: Name
    scene_stamp: float
    limits_hash: Name
    issued: float
    expires: float


class TrajectoryRequest(Message):
    """Asks for a trajectory to be played; answered by Accepted or Refusal.

    Attributes:
        q, qd, qdd: Samples every millisecond in [rad], [rad/s], [rad/s^2], shape (n, 7).
        gripper, segments, joint_names: As in `control.trajectory.Trajectory`.
        certificate: The verdict's certificate; without one the robot refuses.
    """

    type_name: ClassVar[str] = "trajectory_request"
    q: JointRows  # type: ignore[valid-type]
    qd: JointRows  # type: ignore[valid-type]
    qdd: JointRows  # type: ignore[valid-type]
    gripper: Annotated[tuple[GripperEventMessage, ...], Field(max_length=1000)]
    segments: Annotated[tuple[SegmentMessage, ...], Field(max_length=1000)]
    joint_names: Annotated[tuple[Name, ...], Field(max_length=32)]
    certificate: CertificateMessage | None

    @classmethod
    def of(cls, trajectory: Trajectory, certificate: Certificate | None) -> "TrajectoryRequest":
        """The message of a trajectory and its certificate.

        Raises:
            MessageError: Longer than any robot accepts.
        """
        if len(trajectory.q) > MAX_SAMPLES:
            raise MessageError(
                "q", f"has {len(trajectory.q)} samples; at most {MAX_SAMPLES} are accepted; split the motion"
            )
        events = tuple(
            GripperEventMessage(
                time=float(e.time),
                dwell=float(e.dwell),
                kind=e.command.kind,
                width=float(e.command.width),
                force=float(e.command.force),
            )
            for e in trajectory.gripper
        )
        segments = tuple(
            SegmentMessage(name=s.name, start=int(s.start), stop=int(s.stop), held=s.held, touching=s.touching)
            for s in trajectory.segments
        )
        return cls(
            q=np.asarray(trajectory.q, "<f8"),
            qd=np.asarray(trajectory.qd, "<f8"),
            qdd=np.asarray(trajectory.qdd, "<f8"),
            gripper=events,
            segments=segments,
            joint_names=trajectory.joint_names,
            certificate=None if certificate is None else _certificate_message(certificate),
        )

    def trajectory(self) -> Trajectory:
        """The trajectory in this message, bit for bit.

        Raises:
            MessageError: Too long, or arrays that do not belong together.
        """
        if len(self.q) > MAX_SAMPLES:
            raise MessageError("q", f"has {len(self.q)} samples; at most {MAX_SAMPLES} are accepted")
        if self.joint_names != JOINT_NAMES:
            raise MessageError("joint_names", f"are {list(self.joint_names)}; they must be {list(JOINT_NAMES)}")
        events = tuple(GripperEvent(e.time, e.dwell, GripperCommand(e.kind, e.width, e.force)) for e in self.gripper)
        segments = tuple(TrajectorySegment(s.name, s.start, s.stop, s.held, s.touching) for s in self.segments)
        try:
            return Trajectory(self.q, self.qd, self.qdd, events, segments, self.joint_names)
        except TrajectoryError as error:
            raise MessageError("trajectory", str(error)) from error

    def certificate_or_none(self) -> Certificate | None:
        """The certificate in this message."""
        return None if self.certificate is None else Certificate(**self.certificate.model_dump())


def _certificate_message(c: Certificate) -> CertificateMessage:
    values: dict[str, Any] = {
        "serial": c.serial,
        "trajectory_hash": c.trajectory_hash,
        "profile": c.profile,
        "scene_stamp": float(c.scene_stamp),
        "limits_hash": c.limits_hash,
        "issued": float(c.issued),
        "expires": float(c.expires),
    }
    return CertificateMessage(**values)


class Accepted(Message):
    """The robot took the trajectory and begins to play it.

    Attributes:
        serial: Its certificate's serial; RobotState.motion_serial shows it from now on.
        epoch: As in RobotState.
        samples: Number of samples that will be played.
    """

    type_name: ClassVar[str] = "accepted"
    serial: Name
    epoch: Name
    samples: int


class Refusal(Message):
    """The robot did not do what was asked; nothing moved.

    Attributes:
        code: Machine-readable, for instance certificate_used, busy, needs_acknowledge, breaks_limit, bad_message.
        reason: For people.
    """

    type_name: ClassVar[str] = "refusal"
    code: Name
    reason: Text


class StopRequest(Message):
    """Asks the arm to come to rest on its path and stay there until acknowledged.

    Attributes:
        reason: Who or what asked, for the record.
    """

    type_name: ClassVar[str] = "stop_request"
    reason: Text = ""


class AcknowledgeRequest(Message):
    """Says that a person or program has seen why the robot stopped; it becomes idle."""

    type_name: ClassVar[str] = "acknowledge_request"


class ResultRequest(Message):
    """Asks what became of the motion with this serial."""

    type_name: ClassVar[str] = "result_request"
    serial: Name


class MotionResult(Message):
    """What became of a motion, measured by the robot itself.

    Attributes:
        serial: Of its certificate.
        outcome: completed; stopped (on request); reflex (by itself, see trouble).
        trouble: Why it did not complete, or None.
        samples, played: Samples asked for, and how many of them were played.
        started, finished: Times in [s].
        max_tracking_error: Largest difference per joint between commanded and measured position in [rad].
        times: Robot time since the start of each row below in [s], shape (n,); about 100 rows a second.
        q_d, q: Commanded and measured joint positions in [rad], shape (n, 7).
        tau: Measured joint torques in [Nm], shape (n, 7).
        gripper_width: Measured distance between the pads in [m], shape (n,).
    """

    type_name: ClassVar[str] = "motion_result"
    serial: Name
    outcome: Literal["completed", "stopped", "reflex"]
    trouble: Trouble | None
    samples: int
    played: int
    started: float
    finished: float
    max_tracking_error: float
    times: array_field("<f8", (None,))  # type: ignore[valid-type]
    q_d: JointRows  # type: ignore[valid-type]
    q: JointRows  # type: ignore[valid-type]
    tau: JointRows  # type: ignore[valid-type]
    gripper_width: array_field("<f8", (None,))  # type: ignore[valid-type]


class TruthRequest(Message):
    """Asks a simulated cell that was started for scoring where its objects really are."""

    type_name: ClassVar[str] = "truth_request"


class ObjectTruth(Message):
    """True pose of one object: `world_T_object`, shape (4, 4), in [m]."""

    type_name: ClassVar[str] = "object_truth"
    name: Name
    world_T_object: array_field("<f8", (4, 4))  # type: ignore[valid-type]


class Truth(Message):
    """True poses of all objects. For scorers only: nothing that plans, perceives or verifies may ask for it."""

    type_name: ClassVar[str] = "truth"
    stamp: float
    objects: tuple[ObjectTruth, ...]
