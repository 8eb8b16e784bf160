"""A frame with all that follows from it alone, each thing worked out at most once and only when it is asked for."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.frames import RgbdFrame, read_only
from perception.geometry.cloud import StereoNoise, back_project, height_map, to_world
from perception.geometry.depth_cleaning import neighbour_range, speckles, without_pinholes
from perception.geometry.depth_rays import DepthRays
from perception.geometry.support import SupportPlane, estimate_support

STEP = 0.03  # pixels beside a larger step of depth are mixed of front and back, in [m]
FARTHEST = 2.5  # rays beyond this say too little, in [m]
# A surface's direction is told by pixels so far to all sides, in [px]: at 0.7 m the noise leaves 12 degrees of a table.
NORMAL_REACH = 8
MOST_SCALE_STD = 0.025  # more than this is another fault, for instance of the camera's pose
LEAST_CAMERA_HEIGHT = 0.15  # a camera lower than this above the support says nothing of its scale by it, in [m]
THINNING = 4  # every how many rows and columns tell where surfaces around a thing are


@dataclass(frozen=True)
class PreparedFrame(RgbdFrame):
    """An `RgbdFrame` and what follows from it: made once a look, then handed to everything that looks at the frame.

    All arrays are read-only.

    Attributes:
        noise: Of its depth.
        measured: Where depth was measured, bool, shape (height, width), if single pixels that were not have been given
            the nearest one; None where depth is as it came.
    """

    noise: StereoNoise = field(default_factory=StereoNoise)
    measured: NDArray[np.bool_] | None = None

    @classmethod
    def of(cls, frame: RgbdFrame, noise: StereoNoise | None = None) -> "PreparedFrame":
        """The frame itself if it is prepared already and no other noise is asked for, else a new one of it."""
        if isinstance(frame, PreparedFrame) and noise in (None, frame.noise):
            return frame
        measured = frame.measured if isinstance(frame, PreparedFrame) else None
        own = (getattr(frame, f.name) for f in fields(RgbdFrame))
        ready = cls(*own, noise=noise or StereoNoise(), measured=measured)
        filled = without_pinholes(ready.depth, ready.valid_depth)
        return ready if filled is None else replace(ready, depth=filled, measured=ready.valid_depth)

    @property
    def measured_depth(self) -> np.ndarray:
        """Where depth was measured and not taken from beside, bool, shape (height, width)."""
        return self.valid_depth if self.measured is None else self.measured

    def scale_std(self, x: float, y: float) -> float:
        """By which share all its depths may be wrong together, as the height tells at which it shows the support.

        (x, y) in [m] is where in the world it is asked for.

        The world's z = 0 is where things stand. Depth that is too long by a share s shows it lower by s times the
        camera's height. So does a table that truly is lower: the picture does not tell which, and the spread is all of
        it.
        """
        lies = float(self.support.at(x, y))
        height = float(self.world_T_camera[2, 3]) - lies
        if not self.support.seen or height < LEAST_CAMERA_HEIGHT:
            return 0.0
        return min(abs(lies) / height, MOST_SCALE_STD)

    def depth_std(self, depth: float) -> float:
        """Spread of a depth at a distance, both in [m]."""
        return self.noise.depth_std(depth, self.intrinsics.fx)

    @cached_property
    def known_depth(self) -> np.ndarray:
        """Depth in [m], NaN wherever it is no finite number above zero, float32, shape (height, width)."""
        return read_only(np.where(self.valid_depth, self.depth, np.float32(np.nan)))

    @cached_property
    def _depth_range(self) -> np.ndarray:
        return read_only(neighbour_range(self.depth, self.valid_depth))

    def depth_steps(self, step: float) -> np.ndarray:
        """Pixels of known depth beside a step larger than `step` [m], bool, shape (height, width).

        Stereo depth mixes front and back there.
        """
        return self.valid_depth & (self._depth_range > step)

    @cached_property
    def trusted_depth(self) -> np.ndarray:
        """Where depth is known, away from steps and no speckle; bool, shape (height, width)."""
        return read_only(self.valid_depth & ~self.depth_steps(STEP) & ~speckles(self.depth, self.valid_depth))

    @cached_property
    def cloud(self) -> np.ndarray:
        """Where each pixel is in the world in [m], NaN where depth is unknown, shape (height, width, 3)."""
        local = back_project(self.known_depth, self.intrinsics)
        return read_only(to_world(local.reshape(-1, 3), self.world_T_camera).reshape(local.shape))

    def points(self, pixels: np.ndarray) -> np.ndarray:
        """Points in the world in [m] of those pixels whose depth is known, shape (n, 3), row by row.

        Args:
            pixels: bool, shape (height, width).
        """
        return self.cloud[pixels & self.valid_depth]

    def thinned_points(self, without: np.ndarray | None = None) -> np.ndarray:
        """The same of every `THINNING`-th row and column, but for the pixels `without`."""
        every = np.s_[::THINNING, ::THINNING]
        known = self.valid_depth[every]
        return self.cloud[every][known if without is None else known & ~without[every]]

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals of the surfaces in the world, towards the camera, shape (height, width, 3).

        A plane's inverse depth is linear in the pixel, 1/z = w + b (u - u0) + c (v - v0), with the normal

            -(fx b, fy c, w - b (u0 - cx) - c (v0 - cy))

        in the camera's frame. w, b and c are least squares over the window of `NORMAL_REACH` pixels to all sides of
        (u0, v0). NaN where any depth of the window cannot be trusted.
        """
        k, r = self.intrinsics, NORMAL_REACH
        inverse = 1.0 / np.where(self.trusted_depth, self.depth, 1.0).astype(float)
        mean = np.full(2 * r + 1, 1.0 / (2 * r + 1))
        ramp = np.arange(-r, r + 1) / np.sum(np.arange(-r, r + 1) ** 2)
        w, b, c = (cv2.sepFilter2D(inverse, -1, along_u, along_v)
                   for along_u, along_v in ((mean, mean), (ramp, mean), (mean, ramp)))  # fmt: skip
        off_u, off_v = np.arange(k.width) - k.cx, (np.arange(k.height) - k.cy)[:, None]
        normals = -np.stack([k.fx * b, k.fy * c, w - b * off_u - c * off_v], -1) @ self.world_T_camera[:3, :3].T
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        window = np.ones((2 * r + 1, 2 * r + 1), np.uint8)
        whole = cv2.erode(self.trusted_depth.astype(np.uint8), window, borderType=cv2.BORDER_CONSTANT, borderValue=0.0)
        normals[whole == 0] = np.nan
        return read_only(normals)

    @cached_property
    def heights(self) -> np.ndarray:
        """Of every pixel above the world's z = 0 in [m], NaN where depth is unknown, shape (height, width)."""
        return read_only(height_map(self.known_depth, self.intrinsics, self.world_T_camera))

    @cached_property
    def support(self) -> SupportPlane:
        """What things stand on, as far as this frame shows it."""
        return estimate_support(self.thinned_points())

    @cached_property
    def rises(self) -> np.ndarray:
        """Heights above the support in [m], NaN where depth is unknown, shape (height, width)."""
        return read_only(self.heights - self.support.height)

    @cached_property
    def smooth_rises(self) -> np.ndarray:
        """Median of `rises` over 5 x 5 pixels, unknown ones counting as 0, in [m], float32, shape (height, width)."""
        return read_only(cv2.medianBlur(np.where(self.valid_depth, self.rises, 0.0).astype(np.float32), 5))

    @cached_property
    def hsv(self) -> np.ndarray:
        """Hue in [degrees], saturation and value 0..1 of the colours' median over 3 x 3 pixels.

        float32, shape (height, width, 3).
        """
        smooth = cv2.medianBlur(self.colour, 3)
        return read_only(cv2.cvtColor(smooth.astype(np.float32) / 255.0, cv2.COLOR_RGB2HSV))

    @cached_property
    def _rays(self) -> dict[int, DepthRays]:
        return {}

    def rays(self, stride: int) -> DepthRays:
        """Every `stride`-th row and column as rays, without pixels beside depth steps and beyond `FARTHEST`."""
        if stride not in self._rays:
            self._rays[stride] = self._make_rays(stride)
        return self._rays[stride]

    def _make_rays(self, stride: int) -> DepthRays:
        k, pose = self.intrinsics, self.world_T_camera
        first = slice(stride // 2, None, stride)
        keep = np.zeros(self.depth.shape, bool)
        keep[first, first] = (self.valid_depth & ~self.depth_steps(STEP))[first, first]
        v, u = np.nonzero(keep)
        depth = self.depth[v, u].astype(float)
        near = depth < FARTHEST
        v, u, depth = v[near], u[near], depth[near]
        local = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(len(u))], -1)
        slant = np.linalg.norm(local, axis=1)
        direction = (local / slant[:, None]) @ pose[:3, :3].T
        std = self.depth_std(1.0) * depth**2 * slant
        columns = (direction, depth * slant, std, np.zeros(len(u), int), np.stack([v, u], -1))
        return DepthRays(np.broadcast_to(pose[:3, 3], direction.shape), *map(read_only, columns))


def prepared(frames: Sequence[RgbdFrame]) -> list[PreparedFrame]:
    """Frames of one moment, each prepared; those that are prepared already are handed on as they are."""
    return [PreparedFrame.of(frame) for frame in frames]
