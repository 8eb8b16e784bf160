"""The small messages between a cell and the rest. SI units; joint arrays in the order of `JOINT_NAMES`.

State, frames and results come out of a cell; trajectories, stop and acknowledge requests go in. All times are on the
robot process's wall clock in [s] since 1970. Pictures and motions have modules of their own (`frame_message`,
`motion_messages`).
"""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from control.robot.limits import JOINT_NAMES
from hw_interface.messages.wire import Message

Mode = Literal["idle", "moving", "stopping", "stopped", "reflex"]
Name = Annotated[str, Field(min_length=1, max_length=64)]
Text = Annotated[str, Field(max_length=2000)]
Joints = Annotated[tuple[float, ...], Field(min_length=len(JOINT_NAMES), max_length=len(JOINT_NAMES))]


class Trouble(Message):
    """Why the robot stopped by itself.

    Attributes:
        code: tracking_error, lost_grasp, missed_grasp, gripper_late, contact, frozen or internal_error.
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
        progress, samples: Samples of the certified trajectory that were played, and how many it has; at any speed.
        speed: Share of the motion's certified speed at which it is played right now; 0 at rest.
        speed_wanted: Share that this motion changes to, and that the next ones are played at.
        tracking_error: Largest difference per joint between commanded and measured position right now in [rad].
        cell, profile, firmware: Names of the cell, of the robot profile and of its firmware family.
        limits_hash: Hash of the safety and robot limits that certificates must carry.
        last_error: Why the mode is `reflex`, else None.
        robot_mode: What a real robot's own control box says that it does ("idle", "move", "guiding", "reflex",
            "user_stopped", "recovery", "other"); None where there is none.
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
    speed: float
    speed_wanted: float
    tracking_error: float
    cell: Name
    profile: Name
    firmware: Name
    limits_hash: Name
    last_error: Trouble | None
    robot_mode: Name | None


class CellInfo(Message):
    """What a cell offers.

    Attributes:
        epoch: As in RobotState.
        cell, profile, firmware, limits_hash: As in RobotState.
        cameras: Names to ask frames of.
        max_scene_age: Oldest frame in [s] that a motion may have been judged on.
        scored: Whether the key `truth` exists (simulated cells started for a benchmark only).
        simulated: Whether nothing real moves, and robot time stands still whenever the robot process does. False for
            the driver of a real robot, also in front of a simulated control box.
    """

    type_name: ClassVar[str] = "cell_info"
    epoch: Name
    cell: Name
    profile: Name
    firmware: Name
    limits_hash: Name
    cameras: tuple[Name, ...]
    max_scene_age: float
    scored: bool
    simulated: bool


class InfoRequest(Message):
    """Asks for CellInfo."""

    type_name: ClassVar[str] = "info_request"


class StateRequest(Message):
    """Asks for a RobotState measured now."""

    type_name: ClassVar[str] = "state_request"


class FrameRequest(Message):
    """Asks for a picture taken now."""

    type_name: ClassVar[str] = "frame_request"


class Accepted(Message):
    """The robot took the trajectory and begins to play it.

    Attributes:
        serial: Its certificate's serial; RobotState.motion_serial shows it from now on.
        epoch: As in RobotState.
        samples: Number of samples of the trajectory.
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


class SpeedRequest(Message):
    """Asks for the motion, and those after it, to be played at a share of their certified speed.

    Answered by the RobotState, whose `speed` gets there within limits; refused with bad_speed, too_slow, busy (the arm
    is being stopped), no_ramp or breaks_limit, and then nothing changes.

    Attributes:
        speed: Share of the certified speed, above 0 and at most 1.
    """

    type_name: ClassVar[str] = "speed_request"
    speed: float


class AcknowledgeRequest(Message):
    """Says that a person or program has seen why the robot stopped; it becomes idle."""

    type_name: ClassVar[str] = "acknowledge_request"


class ResultRequest(Message):
    """Asks what became of the motion with this serial."""

    type_name: ClassVar[str] = "result_request"
    serial: Name
