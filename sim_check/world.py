"""The simulated cell's truth: what really stands there, where, how heavy. Only the simulated cell and its scorers
may hold a `World`.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

from control.errors import ConfigError
from control.limits import REST_Q
from control.twin_model import ARM_ACTUATORS, ARM_JOINTS, FINGER_JOINTS, GRIPPER_ACTUATOR
from perception.frames import CameraIntrinsics
from sim_check.cell_config import CellConfig, DepthNoiseConfig, PlacementConfig, SimulationConfig
from sim_check.depth_noise import stereo_depth
from sim_check.object_library import ObjectModel, object_model
from sim_check.panda_mjcf import panda_spec
from sim_check.render import CameraView, FreeView, Offscreen
from sim_check.scene_mjcf import (
    add_camera,
    add_lights,
    add_object,
    add_room,
    add_sky,
    add_table,
    place_robot,
    pose_of,
    set_rendering,
)
from sim_check.settling import settle

TRUTH_STEP = 0.001  # [s]
OPEN_WIDTH = 0.08  # between the pads of an open hand in [m]
_TRIES = 500
_AIR = 5e-4  # gap under things when they are put down, in [m]


@dataclass
class World:
    """A simulated cell at rest: arm at REST_Q and holding, gripper open, objects settled.

    Attributes:
        model: Compiled at `TRUTH_STEP`.
        data: Its state; whoever simulates the cell steps it.
        cameras: Cameras that `render` knows.
        objects: What there truly is, by name.
        seed: What placements, mismatch and noise were drawn from.
        depth_noise: Of the cameras, or None for perfect depth.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    cameras: tuple[CameraView, ...]
    objects: dict[str, ObjectModel]
    seed: int
    depth_noise: DepthNoiseConfig | None
    _noise_rng: np.random.Generator
    _renderer: Offscreen | None = field(default=None, repr=False)

    @property
    def object_names(self) -> tuple[str, ...]:
        """Names of what there truly is."""
        return tuple(self.objects)

    def object_pose(self, name: str, data: mujoco.MjData | None = None) -> np.ndarray:
        """True pose of an object's box centre in the world, shape (4, 4).

        Raises:
            ConfigError: There is no such object.
        """
        if name not in self.objects:
            raise ConfigError(f"the simulated cell has no object '{name}'; it has {sorted(self.objects)}")
        body = (self.data if data is None else data).body(name)
        return pose_of(body.xpos, body.xquat)

    def render(
        self, camera_name: str, data: mujoco.MjData | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, CameraIntrinsics]:
        """One RGB-D picture, with stereo noise.

        Call it from one thread only: the first call opens the graphics context in that thread.

        Args:
            camera_name: One of `cameras`.
            data: State to show, for instance a copy; the world's own if None. Nobody may step it meanwhile.

        Returns:
            Colour (uint8, shape (height, width, 3)), depth in [m] (float32, shape (height, width), NaN where
            unknown), world_T_camera (optical frame, shape (4, 4)) and intrinsics.

        Raises:
            ConfigError: No such camera, or no way to render on this machine.
        """
        view = next((c for c in self.cameras if c.name == camera_name), None)
        if view is None:
            raise ConfigError(f"there is no camera '{camera_name}'; there are {[c.name for c in self.cameras]}")
        state = self.data if data is None else data
        lens = view.intrinsics
        colour = self._offscreen().colour(state, camera_name, lens.width, lens.height)
        depth = self._offscreen().depth(state, camera_name, lens.width, lens.height)
        if self.depth_noise is not None:
            depth = stereo_depth(depth, lens.fx, self.depth_noise, self._noise_rng)
        camera = self.model.camera(camera_name).id
        pose = np.eye(4)
        pose[:3, :3] = state.cam_xmat[camera].reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
        pose[:3, 3] = state.cam_xpos[camera]
        return colour, depth, pose, lens

    def spectator(self, view: FreeView | None = None, width: int = 640, height: int = 480) -> np.ndarray:
        """Colour picture from where no camera of the cell stands, for reports; uint8, shape (height, width, 3).

        At most as large as the largest camera's pictures.

        Raises:
            ConfigError: No way to render on this machine.
        """
        return self._offscreen().colour(self.data, view or FreeView(), width, height)

    def _offscreen(self) -> Offscreen:
        if self._renderer is None:
            lenses = [c.intrinsics for c in self.cameras]
            self._renderer = Offscreen(self.model, max(c.width for c in lenses), max(c.height for c in lenses))
        return self._renderer

    def close(self) -> None:
        """Free the graphics context."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def build_world(cell: CellConfig, seed: int, meshes: bool = True, mesh_cache: Path | None = None) -> World:
    """Build a cell's truth; the same cell and seed give the same world.

    Args:
        cell: Cell with a simulation block.
        seed: Source of placements, of the mismatch of masses and friction, and of the cameras' noise.
        meshes: Whether the robot carries its visual meshes.
        mesh_cache: Folder in which converted meshes are kept between runs.

    Raises:
        ConfigError: The cell cannot be simulated, or its objects do not fit where the cell wants them.
        StackError: An object does not come to rest.
    """
    if cell.simulation is None:
        raise ConfigError(f"cell '{cell.name}' has no simulation block; add one, or choose a built-in cell")
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]
    things, poses = _place(cell, cell.simulation, streams[0])
    things = [_mismatched(t, cell.simulation, streams[1]) for t in things]

    spec = panda_spec(meshes=meshes, mesh_cache=mesh_cache)
    place_robot(spec, cell.robot)
    spec.option.timestep = TRUTH_STEP
    add_room(spec, add_table(spec))
    add_sky(spec)
    add_lights(spec)
    for thing, pose in zip(things, poses, strict=True):
        add_object(spec, thing, pose, pictures=True)
    for camera in cell.cameras:
        add_camera(spec, camera)
    set_rendering(spec, max(c.width for c in cell.cameras), max(c.height for c in cell.cameras))
    model = spec.compile()

    data = mujoco.MjData(model)
    for joint, actuator, angle in zip(ARM_JOINTS, ARM_ACTUATORS, REST_Q, strict=True):
        data.joint(joint).qpos[:] = angle
        data.actuator(actuator).ctrl[:] = angle
    for joint in FINGER_JOINTS:
        data.joint(joint).qpos[:] = OPEN_WIDTH / 2
    data.actuator(GRIPPER_ACTUATOR).ctrl[:] = OPEN_WIDTH / 2
    mujoco.mj_forward(model, data)
    settle(model, data)
    data.time = 0.0
    return World(
        model=model,
        data=data,
        cameras=tuple(CameraView(c.name, c.mounting, c.intrinsics) for c in cell.cameras),
        objects={t.name: t for t in things},
        seed=seed,
        depth_noise=cell.simulation.depth_noise,
        _noise_rng=streams[2],
    )


def _mismatched(thing: ObjectModel, simulation: SimulationConfig, rng: np.random.Generator) -> ObjectModel:
    """The thing as heavy and slippery as it truly is, which the twin does not know."""
    mass = thing.mass * (1 + simulation.mass_mismatch * rng.uniform(-1, 1))
    friction = thing.friction * (1 + simulation.friction_mismatch * rng.uniform(-1, 1))
    return replace(thing, mass=mass, friction=friction)


def _place(
    cell: CellConfig, simulation: SimulationConfig, rng: np.random.Generator
) -> tuple[list[ObjectModel], list[np.ndarray]]:
    """Draw a pose for everything: whole arrangements are drawn until nothing on the table is too near to another."""
    present = [p for p in simulation.placements if p.only_if is None or cell.options[p.only_if]]
    things = {p.object: _sized(p, rng) for p in present}
    for p in present:
        support = p.stands_on or p.lies_in
        if support is not None and support not in things:
            raise ConfigError(f"cell '{cell.name}': '{p.object}' needs '{support}', which its options leave out")
        if p.lies_in is not None and not things[p.lies_in].container:
            raise ConfigError(f"cell '{cell.name}': '{p.object}' lies in '{p.lies_in}', which is no container")
    on_table = [p.object for p in present if p.stands_on is None and p.lies_in is None]
    for _ in range(_TRIES):
        poses: dict[str, np.ndarray] = {}
        for p in present:
            poses[p.object] = _draw_pose(p, things, poses, rng)
        if _apart(on_table, things, poses, simulation.gap):
            return [things[p.object] for p in present], [poses[p.object] for p in present]
    raise ConfigError(
        f"cell '{cell.name}': {', '.join(on_table)} do not fit with a gap of {simulation.gap} m in {_TRIES} tries; "
        "widen their spread or lower simulation.gap"
    )


def _sized(placement: PlacementConfig, rng: np.random.Generator) -> ObjectModel:
    extents = None if placement.extents is None else np.asarray(placement.extents)
    extents = object_model(placement.object, extents, "box").extents
    return object_model(placement.object, extents * (1 + placement.size_spread * rng.uniform(-1, 1)), "box")


def _draw_pose(
    placement: PlacementConfig, things: dict[str, ObjectModel], poses: dict[str, np.ndarray], rng: np.random.Generator
) -> np.ndarray:
    local = np.append(np.asarray(placement.position) + np.asarray(placement.spread) * rng.uniform(-1, 1, 2), 0.0)
    yaw = np.deg2rad(placement.yaw_deg + placement.yaw_spread_deg * rng.uniform(-1, 1))
    local[2] = things[placement.object].extents[2] / 2 + _AIR
    pose = pose_of(local, np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]))
    if placement.stands_on is not None:
        pose[2, 3] += things[placement.stands_on].extents[2] / 2
        return poses[placement.stands_on] @ pose
    if placement.lies_in is not None:
        container = things[placement.lies_in]
        pose[2, 3] += container.inner_floor - container.extents[2] / 2
        return poses[placement.lies_in] @ pose
    return pose


def _apart(names: list[str], things: dict[str, ObjectModel], poses: dict[str, np.ndarray], gap: float) -> bool:
    for i, a in enumerate(names):
        for b in names[:i]:
            distance = np.linalg.norm(poses[a][:2, 3] - poses[b][:2, 3])
            if distance < things[a].footprint_radius + things[b].footprint_radius + gap:
                return False
    return True
