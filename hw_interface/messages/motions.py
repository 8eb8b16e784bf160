"""Trajectories on their way to a robot, and what became of them on the way back."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from control.errors import TrajectoryError
from control.robot.limits import JOINT_NAMES
from control.safety.certificate import Certificate
from control.trajectory.samples import GripperCommand, GripperEvent, Trajectory, TrajectorySegment
from hw_interface.errors import MessageError
from hw_interface.messages.robot import Name, Trouble
from hw_interface.messages.wire import Message, array_field

MAX_SAMPLES = 180_000  # three minutes at 1 kHz
JointRows = array_field("<f8", (None, len(JOINT_NAMES)))


class GripperEventMessage(Message):
    """`control.trajectory.samples.GripperEvent` with its command."""

    type_name: ClassVar[str] = "gripper_event"
    time: Annotated[float, Field(ge=0)]
    dwell: Annotated[float, Field(ge=0)]
    kind: Literal["move", "grasp"]
    width: Annotated[float, Field(ge=0)]
    force: Annotated[float, Field(ge=0)]


class SegmentMessage(Message):
    """`control.trajectory.samples.TrajectorySegment`."""

    type_name: ClassVar[str] = "segment"
    name: Name
    start: Annotated[int, Field(ge=0)]
    stop: Annotated[int, Field(ge=0)]
    held: Name | None
    touching: Annotated[tuple[tuple[Name, Name], ...], Field(max_length=1000)]
    held_mass: Annotated[float, Field(ge=0)] | None


class CertificateMessage(Message):
    """`control.safety.certificate.Certificate`."""

    type_name: ClassVar[str] = "certificate"
    serial: Name
    trajectory_hash: Name
    profile: Name
    firmware: Name
    scene_stamp: float
    limits_hash: Name
    issued: float
    expires: float


class TrajectoryRequest(Message):
    """Asks for a trajectory to be played; answered by Accepted or Refusal.

    Attributes:
        epoch: Of the robot process that is meant, as in RobotState. A request that was sent to an earlier run of the
            process, or to another robot, is refused: a restarted process no longer knows which certificates were used.
        operator: Identity of who asks (`hw_interface.cell.operator_lease`); the motion is stopped when that one is
            gone.
        q, qd, qdd: Samples every millisecond in [rad], [rad/s], [rad/s^2], shape (n, 7).
        gripper, segments, joint_names: As in `control.trajectory.samples.Trajectory`.
        certificate: The verdict's certificate; without one the robot refuses.
        speed: Share of the certified speed to play this motion and the next ones at, above 0 and at most 1; None
            leaves it as it is set.
    """

    type_name: ClassVar[str] = "trajectory_request"
    epoch: Name
    operator: Name
    q: JointRows  # type: ignore[valid-type]
    qd: JointRows  # type: ignore[valid-type]
    qdd: JointRows  # type: ignore[valid-type]
    gripper: Annotated[tuple[GripperEventMessage, ...], Field(max_length=1000)]
    segments: Annotated[tuple[SegmentMessage, ...], Field(max_length=1000)]
    joint_names: Annotated[tuple[Name, ...], Field(max_length=32)]
    certificate: CertificateMessage | None
    speed: float | None

    @classmethod
    def of(
        cls,
        trajectory: Trajectory,
        certificate: Certificate | None,
        epoch: str,
        operator: str,
        speed: float | None = None,
    ) -> "TrajectoryRequest":
        """The message of a trajectory with its certificate.

        It names the epoch of the robot that is to play it, who asks, and the share of its speed.

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
            SegmentMessage(
                name=s.name,
                start=int(s.start),
                stop=int(s.stop),
                held=s.held,
                touching=s.touching,
                held_mass=None if s.held_mass is None else float(s.held_mass),
            )
            for s in trajectory.segments
        )
        return cls(
            epoch=epoch,
            operator=operator,
            q=np.asarray(trajectory.q, "<f8"),
            qd=np.asarray(trajectory.qd, "<f8"),
            qdd=np.asarray(trajectory.qdd, "<f8"),
            gripper=events,
            segments=segments,
            joint_names=trajectory.joint_names,
            certificate=None if certificate is None else _certificate_message(certificate),
            speed=None if speed is None else float(speed),
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
        segments = tuple(
            TrajectorySegment(s.name, s.start, s.stop, s.held, s.touching, s.held_mass) for s in self.segments
        )
        try:
            return Trajectory(self.q, self.qd, self.qdd, events, segments, self.joint_names)
        except TrajectoryError as error:
            raise MessageError("trajectory", str(error)) from error

    def certificate_or_none(self) -> Certificate | None:
        """The certificate in this message."""
        return None if self.certificate is None else Certificate(**self.certificate.model_dump())


def _certificate_message(c: Certificate) -> CertificateMessage:
    return CertificateMessage(
        serial=c.serial,
        trajectory_hash=c.trajectory_hash,
        profile=c.profile,
        firmware=c.firmware,
        scene_stamp=float(c.scene_stamp),
        limits_hash=c.limits_hash,
        issued=float(c.issued),
        expires=float(c.expires),
    )


Outcome = Literal["completed", "ended_early", "stopped", "reflex"]


class MotionResult(Message):
    """What became of a motion, measured by the robot itself.

    Attributes:
        serial: Of its certificate.
        outcome: completed; ended_early (a grasp closed on nothing; the robot is ready); stopped (on request); reflex
            (by itself, see trouble).
        trouble: Why it did not complete, or None.
        samples, played: Samples of the certified trajectory, and how many of them were played.
        started, finished: Times in [s].
        max_tracking_error: Largest difference per joint between commanded and measured position in [rad].
        times: Robot time since the start of each row below in [s], shape (n,); about 100 rows a second.
        q_d, q: Commanded and measured joint positions in [rad], shape (n, 7).
        tau: Measured joint torques in [Nm], shape (n, 7).
        gripper_width: Measured distance between the pads in [m], shape (n,).
        speed: Share of the certified speed that was commanded, shape (n,).
    """

    type_name: ClassVar[str] = "motion_result"
    serial: Name
    outcome: Outcome
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
    speed: array_field("<f8", (None,))  # type: ignore[valid-type]
