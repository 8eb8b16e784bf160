"""Pictures of ROS 2 messages into arrays: sensor_msgs Image and CompressedImage, raw, jpeg, png and compressedDepth.

    colour: rgb8, bgr8, rgba8, bgra8, mono8                depth: 16UC1, mono16 (whole units), 32FC1 (metres)

Depth of 16 bits is in millimetres with 0 where unknown (REP 118). Depth of floating point numbers is in metres; NaN is
hidden from one of the two cameras, -inf too near, +inf too far (REP 117), which all are NaN here.

`compressedDepth` puts 12 bytes in front of a PNG of 16 bits: an int32 and two float32 a, b. A picture of 16UC1 is
stored as it is; of 32FC1 the PNG holds inverse depths v, so that  depth = a / (v - b)  and v = 0 is unknown
(compressed_depth_image_transport).
"""

import struct
from typing import Any

import cv2
import numpy as np

from perception.depth_units import MILLIMETRE, depth_in_metres
from perception.errors import FrameError
from perception.picture_bytes import decode_picture

COLOUR = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1}  # channels
DEPTH = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
DEPTH_HEADER = struct.Struct("<iff")


def is_depth(message: Any) -> bool | None:
    """Whether a picture's message holds depth; None where it is neither colour nor depth that can be read."""
    if hasattr(message, "encoding"):
        return True if message.encoding in DEPTH else False if message.encoding in COLOUR else None
    form = message.format.lower()
    return "compresseddepth" in form or form.startswith(("16uc1", "mono16", "32fc1"))


def picture_size(message: Any) -> tuple[int, int]:
    """(width, height) in [px].

    Raises:
        FrameError: A compressed picture that cannot be read.
    """
    if hasattr(message, "encoding"):
        return message.width, message.height
    picture = _decompressed(message) if is_depth(message) else decode_picture(message.data, cv2.IMREAD_COLOR, "it")
    return picture.shape[1], picture.shape[0]


def colour_picture(message: Any) -> np.ndarray:
    """RGB, uint8, shape (height, width, 3).

    Raises:
        FrameError: An encoding that is not colour, too few bytes, or compressed bytes that are no picture.
    """
    if not hasattr(message, "encoding"):
        return cv2.cvtColor(decode_picture(message.data, cv2.IMREAD_COLOR, "its picture"), cv2.COLOR_BGR2RGB)
    if message.encoding not in COLOUR:
        raise FrameError(f"its encoding is '{message.encoding}'; colour is one of {', '.join(COLOUR)}")
    pixels = _pixels(message, np.dtype("u1"), COLOUR[message.encoding])
    if message.encoding == "mono8":
        return np.repeat(pixels, 3, axis=2)
    rgb = pixels[:, :, :3]
    return np.ascontiguousarray(rgb[:, :, ::-1] if message.encoding.startswith("bgr") else rgb)


def depth_picture(message: Any, scale: float | None) -> np.ndarray:
    """Depth in [m], float32, shape (height, width), NaN where unknown.

    Args:
        message: The message.
        scale: Metres per unit of pictures of 16 bits; None for millimetres.

    Raises:
        FrameError: An encoding that is not depth, too few bytes, or compressed bytes that are no picture.
    """
    if not hasattr(message, "encoding"):
        return _whole_or_metres(_decompressed(message), scale)
    if message.encoding not in DEPTH:
        raise FrameError(f"its encoding is '{message.encoding}'; depth is one of {', '.join(DEPTH)}")
    order = ">" if message.is_bigendian else "<"
    pixels = _pixels(message, np.dtype(order + DEPTH[message.encoding]), 1)[:, :, 0]
    return _whole_or_metres(pixels.astype(pixels.dtype.newbyteorder("=")), scale)


def is_in_metres(message: Any) -> bool:
    """Whether a depth picture's message says its unit by being of floating point numbers."""
    return (message.encoding if hasattr(message, "encoding") else message.format).lower().startswith("32fc1")


def _whole_or_metres(picture: np.ndarray, scale: float | None) -> np.ndarray:
    if picture.dtype == np.float32:
        return np.where(np.isfinite(picture) & (picture > 0), picture, np.float32(np.nan))
    return depth_in_metres(picture, scale or MILLIMETRE, "its picture")


def _pixels(message: Any, kind: np.dtype, channels: int) -> np.ndarray:
    """The pixels of an Image, shape (height, width, channels), without the padding of its rows."""
    height, width, step = message.height, message.width, message.step
    row = width * channels * kind.itemsize
    if not height or not width:
        raise FrameError(f"its picture is {width}x{height}")
    if step < row:
        raise FrameError(f"its rows have {step} bytes; {width} pixels of {message.encoding} need {row}")
    if len(message.data) < step * (height - 1) + row:
        raise FrameError(f"it has {len(message.data)} bytes; {height} rows of {step} bytes need {height * step}")
    strides = (step, channels * kind.itemsize, kind.itemsize)
    return np.ndarray((height, width, channels), kind, message.data, strides=strides)


def _decompressed(message: Any) -> np.ndarray:
    """The depth picture of a CompressedImage: uint16 as it is, or float32 in [m]."""
    data, form = message.data, message.format
    if "compresseddepth" not in form.lower():
        return decode_picture(data, cv2.IMREAD_UNCHANGED, "its picture")
    if "rvl" in form.lower():
        raise FrameError(f"its depth is compressed as '{form}'; only png can be read: record it with png")
    if len(data) <= DEPTH_HEADER.size:
        raise FrameError(
            f"its depth has {len(data)} bytes, too few for the header of {DEPTH_HEADER.size} and a picture"
        )
    _, a, b = DEPTH_HEADER.unpack_from(data)
    stored = decode_picture(data[DEPTH_HEADER.size :], cv2.IMREAD_UNCHANGED, "its picture")
    if not is_in_metres(message):
        return stored
    metres = np.full(stored.shape, np.nan, np.float32)
    np.divide(a, stored.astype(np.float32) - b, out=metres, where=stored > 0)
    return metres
