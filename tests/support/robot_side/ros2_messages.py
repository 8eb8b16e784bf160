"""ROS 2 messages for tests: definitions as the distributions have them, without comments and constants.

Messages are written and decoded by mcap-ros2-support, which shares nothing with the product's encoder.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap_ros2._dynamic import generate_dynamic
from mcap_ros2.writer import Writer

DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "trajectory_msgs/JointTrajectoryPoint": (
        "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\n"
        "builtin_interfaces/Duration time_from_start"
    ),
    "trajectory_msgs/JointTrajectory": (
        "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint[] points"
    ),
    "trajectory_msgs/MultiDOFJointTrajectoryPoint": (
        "geometry_msgs/Transform[] transforms\ngeometry_msgs/Twist[] velocities\ngeometry_msgs/Twist[] accelerations\n"
        "builtin_interfaces/Duration time_from_start"
    ),
    "trajectory_msgs/MultiDOFJointTrajectory": (
        "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/MultiDOFJointTrajectoryPoint[] points"
    ),
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/Image": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n"
        "uint8[] data"
    ),
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "sensor_msgs/RegionOfInterest": "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify",
    "sensor_msgs/CameraInfo": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
        "float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi"
    ),
    "diagnostic_msgs/KeyValue": "string key\nstring value",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values"
    ),
    "diagnostic_msgs/DiagnosticArray": "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
    "rcl_interfaces/Log": (
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line"
    ),
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point32": "float32 x\nfloat32 y\nfloat32 z",
    "geometry_msgs/Polygon": "geometry_msgs/Point32[] points",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    "object_recognition_msgs/ObjectType": "string key\nstring db",
    "shape_msgs/Plane": "float64[4] coef",
    "shape_msgs/MeshTriangle": "uint32[3] vertex_indices",
    "shape_msgs/Mesh": "shape_msgs/MeshTriangle[] triangles\ngeometry_msgs/Point[] vertices",
    "shape_msgs/SolidPrimitive": "uint8 type\nfloat64[<=3] dimensions\ngeometry_msgs/Polygon polygon",
    "sensor_msgs/MultiDOFJointState": (
        "std_msgs/Header header\nstring[] joint_names\ngeometry_msgs/Transform[] transforms\n"
        "geometry_msgs/Twist[] twist\ngeometry_msgs/Wrench[] wrench"
    ),
    "moveit_msgs/CollisionObject": (
        "std_msgs/Header header\ngeometry_msgs/Pose pose\nstring id\nobject_recognition_msgs/ObjectType type\n"
        "shape_msgs/SolidPrimitive[] primitives\ngeometry_msgs/Pose[] primitive_poses\nshape_msgs/Mesh[] meshes\n"
        "geometry_msgs/Pose[] mesh_poses\nshape_msgs/Plane[] planes\ngeometry_msgs/Pose[] plane_poses\n"
        "string[] subframe_names\ngeometry_msgs/Pose[] subframe_poses\nbyte operation"
    ),
    "moveit_msgs/AttachedCollisionObject": (
        "string link_name\nmoveit_msgs/CollisionObject object\nstring[] touch_links\n"
        "trajectory_msgs/JointTrajectory detach_posture\nfloat64 weight"
    ),
    "moveit_msgs/RobotState": (
        "sensor_msgs/JointState joint_state\nsensor_msgs/MultiDOFJointState multi_dof_joint_state\n"
        "moveit_msgs/AttachedCollisionObject[] attached_collision_objects\nbool is_diff"
    ),
    "moveit_msgs/DisplayTrajectory": (
        "string model_id\nmoveit_msgs/RobotTrajectory[] trajectory\nmoveit_msgs/RobotState trajectory_start"
    ),
    "moveit_msgs/RobotTrajectory": (
        "trajectory_msgs/JointTrajectory joint_trajectory\n"
        "trajectory_msgs/MultiDOFJointTrajectory multi_dof_joint_trajectory"
    ),
}
TRAJECTORY, ROBOT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory", "moveit_msgs/msg/RobotTrajectory"
DISPLAY = "moveit_msgs/msg/DisplayTrajectory"
STATE, STRING = "sensor_msgs/msg/JointState", "std_msgs/msg/String"


def definition(kind: str) -> str:
    """A type's definition followed by those of all types in it, as recordings carry it."""
    parts, names = [], [kind.replace("/msg/", "/")]
    for name in names:
        text = DEFINITIONS[name]
        parts.append(text if name == names[0] else f"{'=' * 80}\nMSG: {name}\n{text}")
        inside = (line.split()[0].removesuffix("[]") for line in text.splitlines())
        names.extend(n for n in dict.fromkeys(inside) if n in DEFINITIONS and n not in names)
    return "\n".join(parts)


def decode_ros2(kind: str, data: bytes | memoryview) -> Any:
    """A message by the definitions above."""
    return generate_dynamic(kind, definition(kind))[kind](bytes(data))


def moment(seconds: float) -> dict[str, int]:
    """Time or Duration."""
    nanoseconds = round(seconds * 1e9)
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


def header(seconds: float = 0.0) -> dict[str, Any]:
    return {"stamp": moment(seconds), "frame_id": ""}


def joint_trajectory(
    names: Sequence[str], times: np.ndarray, q: np.ndarray, qd: np.ndarray | None = None, qdd: np.ndarray | None = None
) -> dict[str, Any]:
    """A trajectory_msgs/msg/JointTrajectory; times in [s], the rest in the units of its joints, shape (n, names)."""
    points = [
        {
            "positions": q[k].tolist(),
            "velocities": [] if qd is None else qd[k].tolist(),
            "accelerations": [] if qdd is None else qdd[k].tolist(),
            "effort": [],
            "time_from_start": moment(times[k]),
        }
        for k in range(len(times))
    ]
    return {"header": header(), "joint_names": list(names), "points": points}


def joint_state(stamp: float, names: Sequence[str], q: np.ndarray, qd: np.ndarray | None = None) -> dict[str, Any]:
    """A sensor_msgs/msg/JointState; stamp in [s]."""
    speeds = [] if qd is None else qd.tolist()
    return {"header": header(stamp), "name": list(names), "position": q.tolist(), "velocity": speeds, "effort": []}


def write_mcap(path: Path, messages: Sequence[tuple[str, str, dict[str, Any]]], **options: Any) -> Path:
    """Write (topic, type, message) in this order, a millisecond apart; options are those of the writer."""
    with path.open("wb") as file, Writer(file, **options) as writer:
        schemas: dict[str, Any] = {}
        for k, (topic, kind, message) in enumerate(messages):
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(kind, definition(kind))
            writer.write_message(topic, schemas[kind], message, log_time=k * 10**6, publish_time=k * 10**6)
    return path
