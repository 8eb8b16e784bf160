"""Small rendered table scenes with known truth, made of MuJoCo primitives, for the tests of perception."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from perception.frames import CameraIntrinsics, RgbdFrame
from sim_check.models.render import Offscreen


@dataclass(frozen=True)
class Thing:
    """One primitive standing upright.

    Attributes:
        kind: MuJoCo's word: box, sphere, cylinder or ellipsoid.
        half: Half sizes in [m], shape (3,).
        position: Centre in the world in [m], shape (3,).
        rgb: Colour, 0..1.
        yaw: About z in [rad].
    """

    kind: str
    half: tuple[float, float, float]
    position: tuple[float, float, float]
    rgb: tuple[float, float, float]
    yaw: float = 0.0

    @property
    def geom(self) -> str:
        sizes = {"sphere": self.half[:1], "cylinder": (self.half[0], self.half[2])}.get(self.kind, self.half)
        size, position = " ".join(map(str, sizes)), " ".join(map(str, self.position))
        quat = f"{np.cos(self.yaw / 2)} 0 0 {np.sin(self.yaw / 2)}"
        rgba = " ".join(map(str, self.rgb))
        return f'<geom type="{self.kind}" size="{size}" pos="{position}" quat="{quat}" rgba="{rgba} 1"/>'


RED, YELLOW, WOOD, GREEN, BLUE, WHITE = (
    (0.80, 0.10, 0.08),
    (0.92, 0.78, 0.10),
    (0.58, 0.40, 0.22),
    (0.15, 0.60, 0.20),
    (0.15, 0.30, 0.75),
    (0.92, 0.92, 0.92),
)


def cube(
    rgb: tuple[float, float, float], x: float, y: float, bottom: float = 0.0, yaw: float = 0.3, half: float = 0.03
) -> Thing:
    """A cube standing at (x, y) on a surface of height `bottom` [m]."""
    return Thing("box", (half, half, half), (x, y, bottom + half), rgb, yaw)


def look_at(eye: Sequence[float], target: Sequence[float]) -> np.ndarray:
    """world_T_camera of an upright optical frame at `eye` looking at `target`, both in [m], shape (4, 4)."""
    forward = np.subtract(target, eye).astype(float)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], 1)
    pose[:3, 3] = eye
    return pose


def stereo_noise(depth: np.ndarray, rng: np.random.Generator, focal: float, std_px: float = 0.25) -> np.ndarray:
    """Depth with disparity noise shared between neighbours, as stereo matching leaves it; [m] in and out."""
    import cv2

    noise = cv2.GaussianBlur(rng.normal(size=depth.shape).astype(np.float32), (0, 0), 3.0)
    return focal * 0.063 / (focal * 0.063 / depth + noise * (std_px / noise.std()))


def render(
    things: Sequence[Thing],
    eye: Sequence[float] = (1.05, 0.0, 0.65),
    target: Sequence[float] = (0.5, 0.0, 0.0),
    seed: int | None = 0,
    size: tuple[int, int] = (640, 480),
    camera: str = "static",
) -> RgbdFrame:
    """A picture of things on a grey table, with stereo noise unless `seed` is None."""
    width, height = size
    focal = 700.0 * height / 720.0
    fovy = float(np.degrees(2 * np.arctan(height / 2 / focal)))
    pose = look_at(eye, target)
    turned = pose[:3, :3] @ np.diag([1.0, -1.0, -1.0])  # MuJoCo's cameras look along -z with y up
    axes = " ".join(map(str, [*turned[:, 0], *turned[:, 1]]))
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco><statistic extent="1"/><visual><global offwidth="{width}" offheight="{height}"/>
    <map znear="0.02" zfar="10"/><headlight ambient=".35 .35 .35" diffuse=".4 .4 .4"/></visual><worldbody>
    <light pos="0.3 -0.6 2" dir="0.1 0.3 -1" castshadow="false" diffuse=".4 .4 .4"/>
    <geom type="plane" size="3 3 .1" rgba=".55 .55 .56 1"/>{"".join(t.geom for t in things)}
    <camera name="c" pos="{" ".join(map(str, eye))}" xyaxes="{axes}" fovy="{fovy}"/></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with Offscreen(model, width, height) as renderer:
        colour = renderer.colour(data, "c", width, height)
        depth = renderer.depth(data, "c", width, height)
    if seed is not None:
        depth = stereo_noise(depth, np.random.default_rng(seed), focal).astype(np.float32)
    intrinsics = CameraIntrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    return RgbdFrame(colour, depth, intrinsics, pose, 1.0, camera)
