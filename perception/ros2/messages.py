"""Messages of ROS 2 into bytes (CDR, little-endian), their definitions and hashes; by rosbags, without ROS.

Whoever records or shows something builds the types once by `message_types`; nothing is built at import. Recordings are
decoded by mcap-ros2-support instead, which goes by the definitions inside a file and so knows every type.

RIHS01 is ROS 2's hash of a type: two sides with the same hash have the same fields in the same order (REP 2011, 2016).
"""

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from perception.errors import MissingPackageError
from replan_base.parts import install_part

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

HEADER, TIME = "std_msgs/msg/Header", "builtin_interfaces/msg/Time"
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO, REGION = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/RegionOfInterest"
TF, STAMPED = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/TransformStamped"
TRANSFORM, VECTOR, QUATERNION = (f"geometry_msgs/msg/{name}" for name in ("Transform", "Vector3", "Quaternion"))
STRING = "std_msgs/msg/String"


@cache
def message_types() -> "Typestore":
    """ROS 2's message types as of Jazzy, built once, in about 0.2 s; those written here are alike since Iron.

    The first message of a type takes some 10 to 50 ms more, in which the library makes its encoder.

    Raises:
        MissingPackageError: The package rosbags is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError as error:
        raise MissingPackageError(
            f"messages of ROS 2 need the package {error.name}, which is not installed; run: " + install_part("ros2")
        ) from error
    return get_typestore(Stores.ROS2_JAZZY)


def part(kind: str, *values: Any) -> Any:
    """A message that stands inside another one.

    Args:
        kind: Its type, for instance "std_msgs/msg/Header".
        values: Of its fields in their order; numbers of a field of many as an array of the field's type.
    """
    return message_types().types[kind](*values)


def encoded(kind: str, *values: Any) -> memoryview:
    """The bytes of a message, which cannot be changed; arguments as in `part`."""
    return message_types().serialize_cdr(part(kind, *values), kind, little_endian=True)


def type_hash(kind: str) -> str:
    """The hash of a type, as "RIHS01_" and 64 hexadecimal digits.

    Args:
        kind: For instance "sensor_msgs/msg/JointState".
    """
    return message_types().hash_rihs01(kind)


def definition(kind: str) -> str:
    """A type's definition followed by those of all types in it, as recordings carry it (encoding ros2msg).

    Args:
        kind: For instance "sensor_msgs/msg/Image".
    """
    text, _ = message_types().generate_msgdef(kind, ros_version=2)
    return text


def moment(stamp_ns: int) -> Any:
    """A builtin_interfaces/msg/Time."""
    return part(TIME, *divmod(stamp_ns, 10**9))


def header(stamp_ns: int, frame: str) -> Any:
    """A std_msgs/msg/Header."""
    return part(HEADER, moment(stamp_ns), frame)


def numbers(values: np.ndarray | Sequence[float]) -> np.ndarray:
    """Values of a float64[], shape (n,); the library writes the memory of an array as it is."""
    return np.ascontiguousarray(values, np.float64)


def image(stamp_ns: int, frame: str, encoding: str, pixels: np.ndarray) -> memoryview:
    """A sensor_msgs/msg/Image of little-endian pixels, shape (height, width) or (height, width, channels)."""
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<")).reshape(-1).view(np.uint8)
    return encoded(IMAGE, header(stamp_ns, frame), height, width, encoding, 0, len(data) // height, data)


def compressed_image(stamp_ns: int, frame: str, form: str, data: bytes) -> memoryview:
    """A sensor_msgs/msg/CompressedImage."""
    return encoded(COMPRESSED, header(stamp_ns, frame), form, np.frombuffer(data, np.uint8))


def camera_info(stamp_ns: int, frame: str, width: int, height: int, matrix: np.ndarray) -> memoryview:
    """A sensor_msgs/msg/CameraInfo without distortion; matrix is the camera matrix, shape (3, 3)."""
    projection = np.hstack([matrix, np.zeros((3, 1))])
    lens = (numbers(np.zeros(5)), numbers(matrix.ravel()), numbers(np.eye(3).ravel()), numbers(projection.ravel()))
    whole = part(REGION, 0, 0, 0, 0, False)
    return encoded(CAMERA_INFO, header(stamp_ns, frame), height, width, "plumb_bob", *lens, 0, 0, whole)


def transforms(parts: Sequence[tuple[int, str, str, np.ndarray, np.ndarray]]) -> memoryview:
    """A tf2_msgs/msg/TFMessage of (stamp in [ns], parent, child, position (3,) in [m], quaternion x y z w (4,))."""
    return encoded(
        TF,
        [
            part(
                STAMPED,
                header(stamp_ns, parent),
                child,
                part(TRANSFORM, part(VECTOR, *position), part(QUATERNION, *quaternion)),
            )
            for stamp_ns, parent, child, position, quaternion in parts
        ],
    )


def string(text: str) -> memoryview:
    """A std_msgs/msg/String."""
    return encoded(STRING, text)
