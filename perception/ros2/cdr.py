"""Messages of ROS 2 into bytes: definitions as the distributions have them, and their encoding (CDR, little-endian).

Pictures have megabytes, which mcap-ros2-support's writer encodes byte by byte in Python (seconds a picture); so the few
messages that a recording needs are encoded here, and decoded with that package.
"""

import struct
from collections.abc import Sequence

import numpy as np

HEADER = bytes([0, 1, 0, 0])  # plain CDR, little-endian
DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "sensor_msgs/Image": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n"
        "uint8[] data"
    ),
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "sensor_msgs/RegionOfInterest": ("uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify"),
    "sensor_msgs/CameraInfo": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
        "float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi"
    ),
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
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
    "diagnostic_msgs/KeyValue": "string key\nstring value",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values"
    ),
    "diagnostic_msgs/DiagnosticArray": "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
    "rcl_interfaces/Log": (
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line"
    ),
}


def fields(kind: str) -> list[tuple[str, str]]:
    """Type and name of each field of a type in DEFINITIONS, for instance ("float64[9]", "k").

    Args:
        kind: For instance "sensor_msgs/msg/CameraInfo".
    """
    lines = DEFINITIONS[kind.replace("/msg/", "/")].splitlines()
    return [(line.split()[0], line.split()[1]) for line in lines]


def definition(kind: str) -> str:
    """A type's definition followed by those of all types in it, as recordings carry it (encoding ros2msg).

    Args:
        kind: For instance "sensor_msgs/msg/Image".
    """
    parts, names = [], [kind.replace("/msg/", "/")]
    for name in names:
        text = DEFINITIONS[name]
        parts.append(text if name == names[0] else f"{'=' * 80}\nMSG: {name}\n{text}")
        inside = (line.split()[0].removesuffix("[]") for line in text.splitlines())
        names.extend(n for n in dict.fromkeys(inside) if n in DEFINITIONS and n not in names)
    return "\n".join(parts)


class Cdr:
    """Bytes of one message, field after field; numbers are aligned to their own size behind the header."""

    def __init__(self) -> None:
        self._bytes = bytearray(HEADER)

    def put(self, form: str, *values: float) -> "Cdr":
        """Numbers, each by a character of `struct`: B, I, i, d."""
        for code, value in zip(form, values, strict=True):
            size = struct.calcsize(code)
            self._bytes += bytes(-(len(self._bytes) - len(HEADER)) % size) + struct.pack("<" + code, value)
        return self

    def text(self, text: str) -> "Cdr":
        """A string."""
        data = text.encode() + b"\0"
        self.put("I", len(data))
        self._bytes += data
        return self

    def blob(self, data: bytes) -> "Cdr":
        """A uint8[]."""
        self.put("I", len(data))
        self._bytes += data
        return self

    def texts(self, texts: Sequence[str]) -> "Cdr":
        """A string[]."""
        self.put("I", len(texts))
        for text in texts:
            self.text(text)
        return self

    def numbers(self, values: np.ndarray) -> "Cdr":
        """A float64[] of shape (n,)."""
        self.put("I", len(values))
        if len(values):
            self._bytes += bytes(-(len(self._bytes) - len(HEADER)) % 8) + np.asarray(values, "<f8").tobytes()
        return self

    def header(self, stamp_ns: int, frame: str) -> "Cdr":
        """A std_msgs/Header."""
        return self.put("iI", *divmod(stamp_ns, 10**9)).text(frame)

    @property
    def data(self) -> bytes:
        """The whole message."""
        return bytes(self._bytes)


def image(stamp_ns: int, frame: str, encoding: str, pixels: np.ndarray) -> bytes:
    """A sensor_msgs/msg/Image of little-endian pixels, shape (height, width) or (height, width, channels)."""
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<")).tobytes()
    head = Cdr().header(stamp_ns, frame).put("II", height, width).text(encoding)
    return head.put("BI", 0, len(data) // height).blob(data).data


def compressed_image(stamp_ns: int, frame: str, form: str, data: bytes) -> bytes:
    """A sensor_msgs/msg/CompressedImage."""
    return Cdr().header(stamp_ns, frame).text(form).blob(data).data


def camera_info(stamp_ns: int, frame: str, width: int, height: int, matrix: np.ndarray) -> bytes:
    """A sensor_msgs/msg/CameraInfo without distortion; matrix is the camera matrix, shape (3, 3)."""
    projection = np.hstack([matrix, np.zeros((3, 1))])
    out = Cdr().header(stamp_ns, frame).put("II", height, width).text("plumb_bob").put("I", 5).put("d" * 5, *[0.0] * 5)
    out.put("d" * 9, *matrix.ravel()).put("d" * 9, *np.eye(3).ravel()).put("d" * 12, *projection.ravel())
    return out.put("IIIIIIB", 0, 0, 0, 0, 0, 0, 0).data


def transforms(parts: Sequence[tuple[int, str, str, np.ndarray, np.ndarray]]) -> bytes:
    """A tf2_msgs/msg/TFMessage of (stamp in [ns], parent, child, position (3,) in [m], quaternion x y z w (4,))."""
    out = Cdr().put("I", len(parts))
    for stamp_ns, parent, child, position, quaternion in parts:
        out.header(stamp_ns, parent).text(child).put("d" * 7, *position, *quaternion)
    return out.data


def string(text: str) -> bytes:
    """A std_msgs/msg/String."""
    return Cdr().text(text).data
