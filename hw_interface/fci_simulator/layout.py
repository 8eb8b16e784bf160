"""What goes over the wire between libfranka and a Panda's control box: research interface version 5.

Everything is little-endian and packed; arrays of 16 are 4x4 matrices by columns. Source of every layout, number and
name here: frankaemika/libfranka-common at e6aa0fc (Apache-2.0), `robot/rbk_types.h`, `robot/service_types.h`,
`robot/error.h` and `gripper/types.h`; it is what libfranka 0.9.x is built with.
"""

import struct
from enum import IntEnum

import numpy as np

VERSION = 5
PORT = 1337
GRIPPER_VERSION = 3
GRIPPER_PORT = 1338

HEADER = struct.Struct("<III")  # command, its id, bytes of the whole message
GRIPPER_HEADER = struct.Struct("<HII")

_F = "<f8"
STATE = np.dtype(
    [
        ("message_id", "<u8"),  # robot time in [ms]
        ("O_T_EE", _F, 16),
        ("O_T_EE_d", _F, 16),
        ("F_T_EE", _F, 16),
        ("EE_T_K", _F, 16),
        ("F_T_NE", _F, 16),
        ("NE_T_EE", _F, 16),
        ("m_ee", _F),
        ("I_ee", _F, 9),
        ("F_x_Cee", _F, 3),
        ("m_load", _F),
        ("I_load", _F, 9),
        ("F_x_Cload", _F, 3),
        ("elbow", _F, 2),
        ("elbow_d", _F, 2),
        ("tau_J", _F, 7),
        ("tau_J_d", _F, 7),
        ("dtau_J", _F, 7),
        ("q", _F, 7),
        ("q_d", _F, 7),
        ("dq", _F, 7),
        ("dq_d", _F, 7),
        ("ddq_d", _F, 7),
        ("joint_contact", _F, 7),
        ("cartesian_contact", _F, 6),
        ("joint_collision", _F, 7),
        ("cartesian_collision", _F, 6),
        ("tau_ext_hat_filtered", _F, 7),
        ("O_F_ext_hat_K", _F, 6),
        ("K_F_ext_hat_K", _F, 6),
        ("O_dP_EE_d", _F, 6),
        ("O_ddP_O", _F, 3),
        ("elbow_c", _F, 2),
        ("delbow_c", _F, 2),
        ("ddelbow_c", _F, 2),
        ("O_T_EE_c", _F, 16),
        ("O_dP_EE_c", _F, 6),
        ("O_ddP_EE_c", _F, 6),
        ("theta", _F, 7),
        ("dtheta", _F, 7),
        ("motion_generator_mode", "u1"),
        ("controller_mode", "u1"),
        ("errors", "u1", 41),
        ("reflex_reason", "u1", 41),
        ("robot_mode", "u1"),
        ("control_command_success_rate", _F),
    ]
)
COMMAND = np.dtype(
    [
        ("message_id", "<u8"),  # of the state that it answers
        ("q_c", _F, 7),
        ("dq_c", _F, 7),
        ("O_T_EE_c", _F, 16),
        ("O_dP_EE_c", _F, 6),
        ("elbow_c", _F, 2),
        ("valid_elbow", "u1"),
        ("finished", "u1"),
        ("tau_J_d", _F, 7),
    ]
)
GRIPPER_STATE = struct.Struct("<Idd?H")  # message id, width, largest width, grasped, temperature


class Command(IntEnum):
    """Requests to the robot."""

    CONNECT = 0
    MOVE = 1
    STOP_MOVE = 2
    GET_CARTESIAN_LIMIT = 3
    SET_COLLISION_BEHAVIOR = 4
    SET_JOINT_IMPEDANCE = 5
    SET_CARTESIAN_IMPEDANCE = 6
    SET_GUIDING_MODE = 7
    SET_EE_TO_K = 8
    SET_NE_TO_EE = 9
    SET_LOAD = 10
    SET_FILTERS = 11
    AUTOMATIC_ERROR_RECOVERY = 12
    LOAD_MODEL_LIBRARY = 13


class GripperCommandId(IntEnum):
    """Requests to the gripper."""

    CONNECT = 0
    HOMING = 1
    GRASP = 2
    MOVE = 3
    STOP = 4


# Bytes that follow the header of a request.
REQUEST_BYTES = {
    Command.CONNECT: 4,
    Command.MOVE: 2 * 4 + 6 * 8,
    Command.STOP_MOVE: 0,
    Command.GET_CARTESIAN_LIMIT: 4,
    Command.SET_COLLISION_BEHAVIOR: (4 * 7 + 4 * 6) * 8,
    Command.SET_JOINT_IMPEDANCE: 7 * 8,
    Command.SET_CARTESIAN_IMPEDANCE: 6 * 8,
    Command.SET_GUIDING_MODE: 7,
    Command.SET_EE_TO_K: 16 * 8,
    Command.SET_NE_TO_EE: 16 * 8,
    Command.SET_LOAD: (1 + 3 + 9) * 8,
    Command.SET_FILTERS: 5 * 8,
    Command.AUTOMATIC_ERROR_RECOVERY: 0,
    Command.LOAD_MODEL_LIBRARY: 2,
}
GRIPPER_REQUEST_BYTES = {
    GripperCommandId.CONNECT: 4,
    GripperCommandId.HOMING: 0,
    GripperCommandId.GRASP: 5 * 8,
    GripperCommandId.MOVE: 2 * 8,
    GripperCommandId.STOP: 0,
}


class Mode(IntEnum):
    """What the robot does."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    RECOVERY = 6


class Generator(IntEnum):
    """Motion generators as a Move asks for them; a state shows them one higher, 0 being none."""

    JOINT_POSITION = 0
    JOINT_VELOCITY = 1
    CARTESIAN_POSITION = 2
    CARTESIAN_VELOCITY = 3


class Controller(IntEnum):
    """Controllers, in a Move and in a state alike; `OTHER` only in a state."""

    JOINT_IMPEDANCE = 0
    CARTESIAN_IMPEDANCE = 1
    EXTERNAL = 2
    OTHER = 3


class ConnectStatus(IntEnum):
    """Answers to a connect request, robot and gripper alike."""

    SUCCESS = 0
    INCOMPATIBLE_LIBRARY = 1


class MoveStatus(IntEnum):
    """Answers to a Move: STARTED at once, another one at its end."""

    SUCCESS = 0
    STARTED = 1
    PREEMPTED = 2
    NOT_POSSIBLE = 3
    SINGULAR_START = 4
    INVALID_ARGUMENT = 5
    REFLEX_ABORTED = 6
    EMERGENCY_ABORTED = 7
    INPUT_ERROR_ABORTED = 8
    ABORTED = 9


class StopStatus(IntEnum):
    """Answers to a StopMove."""

    SUCCESS = 0
    NOT_POSSIBLE = 1
    EMERGENCY_ABORTED = 2
    REFLEX_ABORTED = 3
    ABORTED = 4


class RecoveryStatus(IntEnum):
    """Answers to an AutomaticErrorRecovery."""

    SUCCESS = 0
    NOT_POSSIBLE = 1
    MANUAL_RECOVERY_REQUIRED = 2
    REFLEX_ABORTED = 3
    EMERGENCY_ABORTED = 4
    ABORTED = 5


class SetStatus(IntEnum):
    """Answers to getters and setters."""

    SUCCESS = 0
    NOT_POSSIBLE = 1
    INVALID_ARGUMENT = 2


class LibraryStatus(IntEnum):
    """Answers to a LoadModelLibrary."""

    SUCCESS = 0
    ERROR = 1


class HandStatus(IntEnum):
    """Answers of the gripper."""

    SUCCESS = 0
    FAIL = 1
    UNSUCCESSFUL = 2
    ABORTED = 3


# Names of the bits of `errors` and `reflex_reason`, as libfranka prints them.
ERROR_NAMES = (
    "joint_position_limits_violation",
    "cartesian_position_limits_violation",
    "self_collision_avoidance_violation",
    "joint_velocity_violation",
    "cartesian_velocity_violation",
    "force_control_safety_violation",
    "joint_reflex",
    "cartesian_reflex",
    "max_goal_pose_deviation_violation",
    "max_path_pose_deviation_violation",
    "cartesian_velocity_profile_safety_violation",
    "joint_position_motion_generator_start_pose_invalid",
    "joint_motion_generator_position_limits_violation",
    "joint_motion_generator_velocity_limits_violation",
    "joint_motion_generator_velocity_discontinuity",
    "joint_motion_generator_acceleration_discontinuity",
    "cartesian_position_motion_generator_start_pose_invalid",
    "cartesian_motion_generator_elbow_limit_violation",
    "cartesian_motion_generator_velocity_limits_violation",
    "cartesian_motion_generator_velocity_discontinuity",
    "cartesian_motion_generator_acceleration_discontinuity",
    "cartesian_motion_generator_elbow_sign_inconsistent",
    "cartesian_motion_generator_start_elbow_invalid",
    "force_controller_desired_force_tolerance_violation",
    "start_elbow_sign_inconsistent",
    "communication_constraints_violation",
    "power_limit_violation",
    "cartesian_motion_generator_joint_position_limits_violation",
    "cartesian_motion_generator_joint_velocity_limits_violation",
    "cartesian_motion_generator_joint_velocity_discontinuity",
    "cartesian_motion_generator_joint_acceleration_discontinuity",
    "cartesian_position_motion_generator_invalid_frame_flag",
    "controller_torque_discontinuity",
    "joint_p2p_insufficient_torque_for_planning",
    "tau_J_range_violation",
    "instability_detected",
    "joint_move_in_wrong_direction",
    "cartesian_spline_motion_generator_violation",
    "joint_via_motion_generator_planning_joint_limit_violation",
    "base_acceleration_initialization_timeout",
    "base_acceleration_invalid_reading",
)


class Error(IntEnum):
    """The bits that the simulated box sets; `ERROR_NAMES` has their names."""

    JOINT_POSITION_LIMITS = 0
    JOINT_VELOCITY = 3
    JOINT_REFLEX = 6
    CARTESIAN_REFLEX = 7
    START_POSE = 11
    COMMANDED_POSITION = 12
    COMMANDED_VELOCITY = 13
    COMMANDED_ACCELERATION = 14
    COMMANDED_JERK = 15
    COMMUNICATION = 25
    TORQUE_DISCONTINUITY = 32
    TORQUE_RANGE = 34

    @property
    def printed(self) -> str:
        """As libfranka prints it."""
        return ERROR_NAMES[self]


def response(command: int, command_id: int, status: int, body: bytes = b"") -> bytes:
    """An answer of the robot."""
    return HEADER.pack(command, command_id, HEADER.size + 1 + len(body)) + bytes([status]) + body


def gripper_response(command: int, command_id: int, status: int, body: bytes = b"") -> bytes:
    """An answer of the gripper."""
    size = GRIPPER_HEADER.size + 2 + len(body)
    return GRIPPER_HEADER.pack(command, command_id, size) + struct.pack("<H", status) + body
