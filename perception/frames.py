"""RGB-D frames: the only thing that perception takes in. Needs numpy only."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from perception.errors import FrameError


def read_only(array: np.ndarray) -> np.ndarray:
    """The array, contiguous and closed to writing; a copy only where it is not contiguous."""
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class CameraIntrinsics:
    """Pinhole camera without distortion.

    Attributes:
        width, height: Picture size in [px].
        fx, fy: Focal lengths in [px].
        cx, cy: Principal point in [px]; the centre of the top-left pixel is (0, 0).
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if self.width <= 0 or self.height <= 0 or not (self.fx > 0 and self.fy > 0):
            raise FrameError(f"camera intrinsics need positive sizes and focal lengths, not {self}")

    @property
    def matrix(self) -> np.ndarray:
        """Camera matrix K, shape (3, 3), in [px]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class RgbdFrame:
    """One colour and depth picture, registered to each other.

    Attributes:
        colour: RGB, uint8, shape (height, width, 3).
        depth: Distance along the optical axis in [m], float32, shape (height, width); NaN where unknown.
        intrinsics: Of both pictures.
        world_T_camera: Pose of the optical frame (x right, y down, z forward) in the world, shape (4, 4).
        stamp: Time of exposure in [s], on the clock of the process that took it.
        camera: Name of the camera, as in the cell file.

    Raises:
        FrameError: Sizes disagree with the intrinsics, wrong types, or a pose that is not rigid.
    """

    colour: NDArray[np.uint8]
    depth: NDArray[np.floating]
    intrinsics: CameraIntrinsics
    world_T_camera: NDArray[np.float64]
    stamp: float
    camera: str = "camera"

    def __post_init__(self) -> None:
        size = (self.intrinsics.height, self.intrinsics.width)
        colour, depth = np.asarray(self.colour), np.asarray(self.depth)
        if colour.shape != (*size, 3) or colour.dtype != np.uint8:
            raise FrameError(
                f"colour picture of camera '{self.camera}' has shape {colour.shape} and type {colour.dtype}; "
                f"its intrinsics ask for {(*size, 3)} of uint8"
            )
        if depth.shape != size:
            raise FrameError(
                f"depth picture of camera '{self.camera}' has shape {depth.shape}; "
                f"its intrinsics ask for {size}; register depth to colour first"
            )
        if not np.issubdtype(depth.dtype, np.floating):
            raise FrameError(
                f"depth of camera '{self.camera}' has type {depth.dtype}; it must be floating point metres "
                "with NaN where unknown (divide 16-bit millimetres by 1000 and set 0 to NaN)"
            )
        pose = np.asarray(self.world_T_camera, float)
        if pose.shape != (4, 4) or not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-5):
            raise FrameError(f"world_T_camera of camera '{self.camera}' is not a rigid (4, 4) transform")
        object.__setattr__(self, "colour", read_only(colour))
        object.__setattr__(self, "depth", read_only(depth.astype(np.float32, copy=False)))
        object.__setattr__(self, "world_T_camera", read_only(pose))

    @cached_property
    def valid_depth(self) -> np.ndarray:
        """Where depth is known: finite and positive, bool, shape (height, width)."""
        return read_only(np.isfinite(self.depth) & (self.depth > 0))
