"""Pictures on the wire."""

from typing import ClassVar

import numpy as np

from hw_interface.errors import MessageError
from hw_interface.messages.robot import Name
from hw_interface.messages.wire import Message, array_field
from perception.errors import FrameError
from perception.frames import CameraIntrinsics, RgbdFrame


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
