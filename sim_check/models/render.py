"""Offscreen pictures of MuJoCo models: colour and metric depth, on a machine with or without a screen."""

import contextlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Literal

import mujoco
import numpy as np

from control.errors import MachineError
from control.twin_model import TwinModel
from perception.frames import CameraIntrinsics
from sim_check.models.panda_mjcf import COLLISION_GROUP

_PACKAGES = "install Debian's libegl1 and libgl1-mesa-dri (`sudo apt install libegl1 libgl1-mesa-dri`)"


@dataclass(frozen=True)
class CameraView:
    """A camera of a model.

    Attributes:
        name: Its name in the model and in frames.
        mounting: Whether it stands in the world or rides on the hand.
        intrinsics: Of its pictures.
    """

    name: str
    mounting: Literal["static", "wrist"]
    intrinsics: CameraIntrinsics


@dataclass(frozen=True)
class FreeView:
    """Where a spectator stands.

    Attributes:
        look_at: Point in the middle of the picture, in the world in [m].
        distance: From there to the eye in [m].
        azimuth_deg: Direction of view about z in [degrees]; 0 looks along +x, 180 towards the robot from the front.
        elevation_deg: Direction of view against the horizon in [degrees]; negative looks down.
    """

    look_at: tuple[float, float, float] = (0.32, 0.0, 0.30)
    distance: float = 1.42
    azimuth_deg: float = 148.0
    elevation_deg: float = -24.0


class Offscreen:
    """Renders one model. Use it from one thread; a model's pictures need its data to hold still meanwhile.

    Colour is smoothed over several samples a pixel. Depth is not: a smoothed depth buffer holds some corner's depth
    instead of the pixel's centre, which tilts into half a millimetre at 1 m. So depth has a pass of its own, without
    light and shadow, which costs a quarter of the colour's.

    Args:
        model: What to render.
        width, height: Largest picture in [px].
        collision: Whether to show collision bodies (group 3) besides pictures (group 2).

    Raises:
        MachineError: No way to render was found; names the packages to install.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int, collision: bool = False) -> None:
        self._model = model
        self._size = (width, height)
        self._closed = False
        _, self._context = _open_context(width, height)
        self._context.make_current()
        self._smooth = self._buffers(model.vis.quality.offsamples)
        self._sharp: mujoco.MjrContext | None = None
        self._scene = mujoco.MjvScene(model, maxgeom=2000)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[COLLISION_GROUP] = collision
        self._option.sitegroup[:] = 0

    def __enter__(self) -> "Offscreen":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free what the graphics driver holds."""
        if not self._closed:
            self._context.make_current()
            self._smooth.free()
            if self._sharp is not None:
                self._sharp.free()
            self._context.free()
            self._closed = True

    def colour(self, data: mujoco.MjData, view: str | FreeView, width: int, height: int) -> np.ndarray:
        """Colour picture of one view.

        Args:
            data: State to show; forwarded, and not stepped meanwhile.
            view: Name of a camera of the model, or a spectator.
            width, height: Size in [px], at most that of the constructor.

        Returns:
            uint8, shape (height, width, 3).
        """
        rect = self._draw(self._smooth, data, view, width, height)
        picture = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(picture, None, rect, self._smooth)
        return np.flipud(picture).copy()

    def depth(self, data: mujoco.MjData, view: str | FreeView, width: int, height: int) -> np.ndarray:
        """Distance along the optical axis in [m], at the pixels' centres; arguments as for `colour`.

        Returns:
            float32, shape (height, width), NaN where there is nothing up to the far plane.
        """
        with self._flat(data, view, width, height) as (_, sharp, rect):
            return self._depth(sharp, rect)

    def bodies(
        self, data: mujoco.MjData, view: str | FreeView, width: int, height: int, roots: Sequence[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Which body each pixel shows; arguments as for `colour`.

        Args:
            roots: Bodies (their numbers), each with everything that hangs on it.

        Returns:
            Labels, uint16, shape (height, width): 1 + index into `roots`, 0 for everything else. And for each root how
            many pixels it would have with nothing in front of it, shape (len(roots),).
        """
        with self._flat(data, view, width, height) as (scene, sharp, rect):
            label_of = np.zeros(scene.ngeom + 1, np.uint16)
            for geom in scene.geoms[: scene.ngeom]:
                if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and geom.segid >= 0:
                    root = self._model.body_rootid[self._model.geom_bodyid[geom.objid]]
                    label_of[geom.segid + 1] = roots.index(root) + 1 if root in roots else 0
            labels = label_of[_numbers(sharp, rect)]
            numbers = np.array([g.segid for g in scene.geoms[: scene.ngeom]])
            alone = np.zeros(len(roots), int)
            for k in range(len(roots)):
                for geom, number in zip(scene.geoms[: scene.ngeom], numbers, strict=True):
                    geom.segid = number if label_of[number + 1] == k + 1 else -1  # what has no number is not drawn
                mujoco.mjr_render(rect, scene, sharp)
                alone[k] = np.count_nonzero(label_of[_numbers(sharp, rect)] == k + 1)
        return labels, alone

    def depth_and_geoms(
        self, data: mujoco.MjData, view: str | FreeView, width: int, height: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Depth as `depth` gives it, and which geom each pixel shows; arguments as for `colour`.

        Returns:
            Depth in [m], float32, and ids of the model's geoms, int32, -1 where there is none; (height, width) each.
        """
        with self._flat(data, view, width, height) as (scene, sharp, rect):
            geom_of = np.full(scene.ngeom + 1, -1, np.int32)
            for drawn in scene.geoms[: scene.ngeom]:
                if drawn.objtype == mujoco.mjtObj.mjOBJ_GEOM and drawn.segid >= 0:
                    geom_of[drawn.segid + 1] = drawn.objid
            return self._depth(sharp, rect), geom_of[_numbers(sharp, rect)]

    def upload_texture(self, texture: int) -> None:
        """Show a texture of the model as it is now, after its data were rewritten."""
        self._context.make_current()
        mujoco.mjr_uploadTexture(self._model, self._smooth, texture)

    @contextlib.contextmanager
    def _flat(
        self, data: mujoco.MjData, view: str | FreeView, width: int, height: int
    ) -> Iterator[tuple[mujoco.MjvScene, mujoco.MjrContext, mujoco.MjrRect]]:
        """A view drawn without light and smoothing, everything painted in the colour of its number."""
        if self._sharp is None:
            self._context.make_current()
            self._sharp = self._buffers(0)
        flags = [int(mujoco.mjtRndFlag.mjRND_SEGMENT), int(mujoco.mjtRndFlag.mjRND_IDCOLOR)]
        self._scene.flags[flags] = 1
        try:
            yield self._scene, self._sharp, self._draw(self._sharp, data, view, width, height)
        finally:
            self._scene.flags[flags] = 0

    def _depth(self, buffers: mujoco.MjrContext, rect: mujoco.MjrRect) -> np.ndarray:
        """Depth in [m] of what was drawn, shape (height, width)."""
        buffer = np.empty((rect.height, rect.width), np.float32)
        mujoco.mjr_readPixels(None, buffer, rect, buffers)
        return self._metres(np.flipud(buffer))

    def _buffers(self, samples: int) -> mujoco.MjrContext:
        """Offscreen buffers with this many samples a pixel, which MuJoCo reads from the model."""
        quality = self._model.vis.quality
        before = quality.offsamples
        quality.offsamples = samples
        try:
            buffers = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        finally:
            quality.offsamples = before
        mujoco.mjr_resizeOffscreen(*self._size, buffers)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, buffers)
        buffers.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        return buffers

    def _draw(
        self, buffers: mujoco.MjrContext, data: mujoco.MjData, view: str | FreeView, width: int, height: int
    ) -> mujoco.MjrRect:
        camera = mujoco.MjvCamera()
        if isinstance(view, str):
            camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
            camera.fixedcamid = self._model.camera(view).id
        else:
            camera.type = mujoco.mjtCamera.mjCAMERA_FREE
            camera.lookat[:] = view.look_at
            camera.distance = view.distance
            camera.azimuth, camera.elevation = view.azimuth_deg, view.elevation_deg
        self._context.make_current()
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, buffers)
        mujoco.mjv_updateScene(self._model, data, self._option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, self._scene)
        rect = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(rect, self._scene, buffers)
        return rect

    def _metres(self, buffer: np.ndarray) -> np.ndarray:
        """Depth from a depth buffer that is 1 on the near plane n and 0 on the far plane f.

        The projection's reversed depth is b = n (f - z) / (z (f - n)), hence z = f n / (n + b (f - n)).
        """
        extent = self._model.stat.extent
        near, far = self._model.vis.map.znear * extent, self._model.vis.map.zfar * extent
        depth = far * near / (near + buffer.astype(np.float64) * (far - near))
        return np.where(buffer <= 0.0, np.nan, depth).astype(np.float32)


def _numbers(buffers: mujoco.MjrContext, rect: mujoco.MjrRect) -> np.ndarray:
    """Numbers that the pixels' colours say, plus 1; 0 is background; shape (height, width)."""
    picture = np.empty((rect.height, rect.width, 3), np.uint8)
    mujoco.mjr_readPixels(picture, None, rect, buffers)
    return np.flipud(picture).astype(np.int64) @ np.array([1, 1 << 8, 1 << 16])


def available_backend() -> str:
    """Which way of rendering works here: "egl", or what the environment variable MUJOCO_GL asks for.

    Raises:
        MachineError: None does; names the packages to install.
    """
    name, context = _open_context(64, 64)
    context.free()
    return name


def render_twin(
    twin: TwinModel, width: int = 640, height: int = 480, view: FreeView | None = None, qpos: np.ndarray | None = None
) -> np.ndarray:
    """A picture of a twin for reports: what the stack believes, collision bodies included.

    Args:
        twin: What to show.
        width, height: Size in [px].
        view: Where the spectator stands.
        qpos: Configuration to show, shape (nq,); the start if None.

    Returns:
        Colour, uint8, shape (height, width, 3).

    Raises:
        MachineError: No way to render was found.
    """
    data = twin.start()
    if qpos is not None:
        data.qpos[:] = qpos
        mujoco.mj_forward(twin.model, data)
    with Offscreen(twin.model, width, height, collision=True) as renderer:
        return renderer.colour(data, view or FreeView(), width, height)


def _open_context(width: int, height: int):
    """(name, context) of the first way to render that works."""
    asked = os.environ.get("MUJOCO_GL", "").lower()
    name = asked if asked in ("glfw", "osmesa") else "egl"
    try:
        # The context class is named directly: MuJoCo's own choice is made from the environment at its import.
        if name == "glfw":
            from mujoco.glfw import GLContext
        elif name == "osmesa":
            from mujoco.osmesa import GLContext
        else:
            from mujoco.egl import GLContext
        return name, GLContext(width, height)
    # Missing libraries surface as ImportError, AttributeError (PyOpenGL's null library) or OpenGL's own error types.
    except Exception as error:
        raise MachineError(
            f"cannot render offscreen with '{name}' ({error}); {_PACKAGES}, or set MUJOCO_GL=glfw"
        ) from None
