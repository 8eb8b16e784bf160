"""Frames into an MCAP file that ROS 2's tools read and `open_recording` gives back.

/<camera>/color/image_raw                    Image rgb8, or .../compressed CompressedImage png
/<camera>/aligned_depth_to_color/image_raw   Image 16UC1 in [mm] or 32FC1 in [m], or .../compressedDepth png
/<camera>/color/camera_info, /<camera>/aligned_depth_to_color/camera_info
/tf, /tf_static                              world -> <camera>_color_optical_frame
/replan/truth, /<camera>/truth/labels        what truly was there (`perception.recordings.recorded_truth`), if it is
known
"""

import struct
from collections.abc import Collection
from pathlib import Path
from types import TracebackType
from typing import Literal

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from perception.frames import RgbdFrame
from perception.ground_truth import FrameTruth
from perception.recordings.recorded_truth import LABELS_ENDING, TRUTH_TOPIC, RecordedObject, RecordedTruth
from perception.ros2.mcap_file import Ros2McapFile
from perception.ros2.messages import (
    CAMERA_INFO,
    COMPRESSED,
    IMAGE,
    STRING,
    TF,
    camera_info,
    compressed_image,
    image,
    string,
    transforms,
)
from perception.ros2.topic_names import topic_name

DepthKind = Literal["16UC1", "32FC1"]
WORLD = "world"
MM = 1000.0  # units of 16-bit depth a metre


class McapFrameWriter:
    """Writes frames of any number of cameras; use it as a context manager, which completes the file however it ends.

    Args:
        path: File to write.
        depth: Whole millimetres (rounded, up to 65.5 m), or floating point metres as they are.
        compress: Colour and depth as PNG, for 16UC1 only.
        fixed: Names of cameras that do not move; their first pose goes to /tf_static.

    Raises:
        ValueError: 32FC1 that is to be compressed.
        OSError: The file cannot be written.
    """

    def __init__(
        self, path: Path, depth: DepthKind = "16UC1", compress: bool = False, fixed: Collection[str] = ()
    ) -> None:
        if compress and depth != "16UC1":
            raise ValueError("a PNG holds 16-bit depth only")
        self._depth: DepthKind = depth
        self._compress = compress
        self._fixed = frozenset(fixed)
        self._placed: set[str] = set()
        self._file = Ros2McapFile(path)

    def __enter__(self) -> "McapFrameWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Complete the file."""
        self._file.close()

    def write(self, frame: RgbdFrame, truth: FrameTruth | None = None) -> None:
        """Add a frame.

        Args:
            frame: The frame; characters of its camera's name that no topic may have become underscores.
            truth: What truly was in it, for scorers who read the file.
        """
        camera = topic_name(frame.camera)
        stamp, optical = round(frame.stamp * 1e9), f"{camera}_color_optical_frame"
        self._pose(frame, stamp, optical)
        if truth is not None:
            self._truth(frame, camera, stamp, optical, truth)
        k = frame.intrinsics
        info = camera_info(stamp, optical, k.width, k.height, k.matrix)
        depth = frame.depth
        if self._depth == "16UC1":
            millimetres = np.rint(np.nan_to_num(depth, nan=0.0, posinf=0.0, neginf=0.0) * MM)
            depth = np.where((millimetres >= 1) & (millimetres <= 65535), millimetres, 0).astype(np.uint16)
        for topic, encoding, pixels in (
            (f"/{camera}/color", "rgb8", frame.colour),
            (f"/{camera}/aligned_depth_to_color", self._depth, depth),
        ):
            self._file.put(f"{topic}/camera_info", CAMERA_INFO, stamp, info)
            if self._compress:
                ending, form, data = _compressed(encoding, pixels)
                self._file.put(
                    f"{topic}/image_raw/{ending}", COMPRESSED, stamp, compressed_image(stamp, optical, form, data)
                )
            else:
                self._file.put(f"{topic}/image_raw", IMAGE, stamp, image(stamp, optical, encoding, pixels))

    def _pose(self, frame: RgbdFrame, stamp: int, optical: str) -> None:
        fixed = frame.camera in self._fixed
        if fixed and optical in self._placed:
            return
        self._placed.add(optical)
        turned = Rotation.from_matrix(frame.world_T_camera[:3, :3]).as_quat()
        part = (stamp, WORLD, optical, frame.world_T_camera[:3, 3], turned)
        self._file.put("/tf_static" if fixed else "/tf", TF, stamp, transforms([part]))

    def _truth(self, frame: RgbdFrame, camera: str, stamp: int, optical: str, truth: FrameTruth) -> None:
        labels = np.zeros(frame.depth.shape, np.uint16)
        objects = []
        for number, o in enumerate(truth.objects, 1):
            if o.mask is not None:
                labels[o.mask] = number
            objects.append(
                RecordedObject(
                    name=o.name,
                    world_T_object=o.world_T_object.tolist(),
                    extents=None if o.extents is None else tuple(o.extents.tolist()),
                    shape=o.shape,
                    label=None if o.mask is None else number,
                    visible_share=o.visible_share,
                    joint_fractions=dict(o.joint_fractions),
                )
            )
        text = RecordedTruth(camera=camera, stamp_ns=stamp, objects=tuple(objects), absent=truth.absent)
        self._file.put(TRUTH_TOPIC, STRING, stamp, string(text.model_dump_json()))
        if any(o.mask is not None for o in truth.objects):
            self._file.put(f"/{camera}{LABELS_ENDING}", IMAGE, stamp, image(stamp, optical, "mono16", labels))


def _compressed(encoding: str, pixels: np.ndarray) -> tuple[str, str, bytes]:
    """Ending of the topic, format and bytes, as image_transport's plugins write them."""
    if encoding == "rgb8":
        _, data = cv2.imencode(".png", np.ascontiguousarray(pixels[:, :, ::-1]))
        return "compressed", "rgb8; png compressed bgr8", data.tobytes()
    _, data = cv2.imencode(".png", pixels)
    # int32 and two parameters of the quantisation of floating point depth, which whole numbers do not need.
    return "compressedDepth", "16UC1; compressedDepth png", struct.pack("<iff", 0, 0.0, 0.0) + data.tobytes()
