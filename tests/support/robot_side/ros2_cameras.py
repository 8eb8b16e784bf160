"""ROS 2 messages of cameras for tests, encoded by another program's writer."""

import struct
from typing import Any

import cv2
import numpy as np

from tests.support.robot_side.ros2_messages import moment

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
INFO, TF = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"
OPTICAL = "cam_optical"
Message = tuple[str, str, dict[str, Any]]


def header(stamp: float, frame: str = OPTICAL) -> dict[str, Any]:
    """A header; stamp in [s]."""
    return {"stamp": moment(stamp), "frame_id": frame}


def image(
    topic: str, stamp: float, encoding: str, pixels: np.ndarray, frame: str = OPTICAL, big: bool = False, pad: int = 0
) -> Message:
    """An Image; `pad` bytes stand behind each row."""
    stored = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<"))
    rows = [row.tobytes() + b"\x5a" * pad for row in stored]
    content = {
        "header": header(stamp, frame),
        "height": pixels.shape[0],
        "width": pixels.shape[1],
        "encoding": encoding,
        "is_bigendian": int(big),
        "step": len(rows[0]),
        "data": b"".join(rows),
    }
    return topic, IMAGE, content


def compressed(topic: str, stamp: float, form: str, data: bytes, frame: str = OPTICAL) -> Message:
    """A CompressedImage."""
    return topic, COMPRESSED, {"header": header(stamp, frame), "format": form, "data": data}


def png(pixels: np.ndarray, ending: str = ".png") -> bytes:
    """Bytes of a picture; colour is blue, green, red."""
    return cv2.imencode(ending, pixels)[1].tobytes()


def quantised_depth(metres: np.ndarray, a: float, b: float) -> bytes:
    """compressedDepth of floating point numbers: inverse depths a / z + b as a PNG behind its 12 bytes."""
    inverse = np.where(np.isfinite(metres), np.rint(a / np.nan_to_num(metres, nan=1.0) + b), 0)
    return struct.pack("<iff", 0, a, b) + png(inverse.astype(np.uint16))


def info(topic: str, width: int, height: int, frame: str = OPTICAL, **fields: Any) -> Message:
    """A CameraInfo of fx 10, fy 11 with its principal point in the middle."""
    k = [10.0, 0.0, (width - 1) / 2, 0.0, 11.0, (height - 1) / 2, 0.0, 0.0, 1.0]
    content = {
        "header": header(0.0, frame),
        "height": height,
        "width": width,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": k,
        "r": np.eye(3).ravel().tolist(),
        "p": [*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }
    return topic, INFO, {**content, **fields}


def tf(
    stamp: float,
    parent: str,
    child: str,
    position=(0.0, 0.0, 0.0),
    quaternion=(0.0, 0.0, 0.0, 1.0),
    topic: str = "/tf",
) -> Message:
    """A TFMessage of one transform."""
    turned = dict(zip("xyzw", (float(v) for v in quaternion), strict=True))
    moved = dict(zip("xyz", (float(v) for v in position), strict=True))
    part = {
        "header": header(stamp, parent),
        "child_frame_id": child,
        "transform": {"translation": moved, "rotation": turned},
    }
    return topic, TF, {"transforms": [part]}
