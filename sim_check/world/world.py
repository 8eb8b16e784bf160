"""The simulated cell's truth: what really stands there, where, how heavy.

Only the simulated cell and its scorers may hold a `World`.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np

from control.errors import ConfigError
from control.robot.limits import REST_Q
from control.twin_model import ARM_ACTUATORS, ARM_JOINTS, FINGER_JOINTS, GRIPPER_ACTUATOR
from perception.estimates import Shape
from perception.frames import CameraIntrinsics
from perception.ground_truth import CellTruth, FrameTruth, StandingThing, TrueJoint, TrueObject, box_around
from sim_check.cells.cell_config import CellConfig, DepthNoiseConfig, SimulationConfig
from sim_check.furniture.locks import add_lock
from sim_check.furniture.mjcf import add_furniture, set_fractions
from sim_check.furniture.model import FurnitureModel
from sim_check.models.panda_mjcf import panda_spec
from sim_check.models.render import CameraView, FreeView, Offscreen
from sim_check.models.scene_mjcf import (
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
from sim_check.objects.library import ObjectModel
from sim_check.twin.settling import settle
from sim_check.world.arrangement import arrange
from sim_check.world.depth_noise import stereo_depth

TRUTH_STEP = 0.001  # [s]
LEAST_PIXELS = 10  # [px]; a thing that shows less is not in a picture


@dataclass
class World:
    """A simulated cell at rest: arm at REST_Q and holding, gripper open, objects settled.

    Attributes:
        model: Compiled at `TRUTH_STEP`.
        data: Its state; whoever simulates the cell steps it.
        cameras: Cameras that `render` knows.
        objects: What there truly is, by name.
        furniture: What stands fixed, by name.
        seed: What placements, mismatch and noise were drawn from.
        depth_noise: Of the cameras, or None for perfect depth.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    cameras: tuple[CameraView, ...]
    objects: dict[str, ObjectModel]
    furniture: dict[str, FurnitureModel]
    seed: int
    depth_noise: DepthNoiseConfig | None
    _noise_rng: np.random.Generator
    _renderer: Offscreen | None = field(default=None, repr=False)

    @property
    def object_names(self) -> tuple[str, ...]:
        """Names of what there truly is, furniture apart."""
        return tuple(self.objects)

    @property
    def furniture_names(self) -> tuple[str, ...]:
        """Names of the furniture."""
        return tuple(self.furniture)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of everything on a joint: doors, levers, sprung plates."""
        return tuple(p.name for f in self.furniture.values() for p in f.parts)

    def joint_fraction(self, name: str, data: mujoco.MjData | None = None) -> float:
        """How far a joint of furniture truly is open, 0 closed .. 1 open.

        Raises:
            ConfigError: There is no such joint.
        """
        for thing in self.furniture.values():
            part = thing.part(name)
            if part is not None:
                return float((self.data if data is None else data).joint(name).qpos[0]) / part.opened
        raise ConfigError(f"the simulated cell has no joint '{name}'; it has {sorted(self.joint_names)}")

    def object_pose(self, name: str, data: mujoco.MjData | None = None) -> np.ndarray:
        """True pose of an object's or furniture's box centre in the world, shape (4, 4).

        Raises:
            ConfigError: There is no such object.
        """
        if name not in self.objects and name not in self.furniture:
            names = sorted([*self.objects, *self.furniture])
            raise ConfigError(f"the simulated cell has no object '{name}'; it has {names}")
        body = (self.data if data is None else data).body(name)
        return pose_of(body.xpos, body.xquat)

    def truth(self) -> CellTruth:
        """Everything that stands here now."""
        things = {}
        for name, thing in {**self.objects, **self.furniture}.items():
            turning_first = np.zeros(6)
            body = self.model.body(name).id
            mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, body, turning_first, 0)
            velocity = np.roll(turning_first, 3)
            pose = self.object_pose(name)
            things[name] = StandingThing(name, pose, thing.extents, velocity, name in self.furniture)
        joints = {
            p.name: TrueJoint(p.name, float(self.data.joint(p.name).qpos[0]), self.joint_fraction(p.name))
            for f in self.furniture.values()
            for p in f.parts
        }
        return CellTruth(things, joints)

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
        view = self._view(camera_name)
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

    def frame_truth(self, camera_name: str) -> FrameTruth:
        """What truly is in a camera's picture of now: objects and furniture that show at least `LEAST_PIXELS`.

        Call it from the thread that renders. Where the noise of the cameras' depth loses pixels, masks keep them.

        Raises:
            ConfigError: No such camera, or no way to render on this machine.
        """
        lens = self._view(camera_name).intrinsics
        things = {**self.objects, **self.furniture}
        roots = [int(self.model.body(name).id) for name in things]
        labels, alone = self._offscreen().bodies(self.data, camera_name, lens.width, lens.height, roots)
        found = []
        for k, (name, thing) in enumerate(things.items()):
            mask = labels == k + 1
            seen = int(mask.sum())
            if seen < LEAST_PIXELS:
                continue
            parts = self.furniture[name].parts if name in self.furniture else ()
            found.append(
                TrueObject(
                    name,
                    self.object_pose(name),
                    thing.extents,
                    _shape(thing),
                    mask,
                    box_around(mask),
                    min(1.0, seen / max(1, int(alone[k]))),
                    {p.name: self.joint_fraction(p.name) for p in parts},
                )
            )
        return FrameTruth(tuple(found))

    def _view(self, camera_name: str) -> CameraView:
        view = next((c for c in self.cameras if c.name == camera_name), None)
        if view is None:
            raise ConfigError(f"there is no camera '{camera_name}'; there are {[c.name for c in self.cameras]}")
        return view

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
    placed = arrange(cell, cell.simulation, streams[0])
    things = [_mismatched(t, cell.simulation, streams[1]) for t, _ in placed.objects]
    furniture = {f.name: f for f, _ in placed.furniture}

    gripper = cell.robot.gripper_model
    spec = panda_spec(meshes=meshes, mesh_cache=mesh_cache, gripper=gripper)
    place_robot(spec, cell.robot)
    spec.option.timestep = TRUTH_STEP
    add_room(spec, add_table(spec))
    add_sky(spec)
    add_lights(spec)
    for fixed, pose in placed.furniture:
        add_furniture(spec, fixed, pose, pictures=True)
    for lock in cell.simulation.locks:
        add_lock(spec, lock, furniture)
    for thing, (_, pose) in zip(things, placed.objects, strict=True):
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
        data.joint(joint).qpos[:] = gripper.opening / 2
    data.actuator(GRIPPER_ACTUATOR).ctrl[:] = gripper.opening / 2
    for fixed in furniture.values():
        set_fractions(model, data.qpos, fixed, placed.fractions)
    mujoco.mj_forward(model, data)
    settle(model, data)
    data.time = 0.0
    return World(
        model=model,
        data=data,
        cameras=tuple(CameraView(c.name, c.mounting, c.intrinsics) for c in cell.cameras),
        objects={t.name: t for t in things},
        furniture=furniture,
        seed=seed,
        depth_noise=cell.simulation.depth_noise,
        _noise_rng=streams[2],
    )


def _shape(thing: ObjectModel | FurnitureModel) -> Shape | None:
    """The solid that a thing is, if it is one of those that perception knows."""
    if isinstance(thing, FurnitureModel) or len(thing.solids) != 1:
        return None
    kind = thing.solids[0].kind
    return kind if kind in ("box", "cylinder", "sphere") else None


def _mismatched(thing: ObjectModel, simulation: SimulationConfig, rng: np.random.Generator) -> ObjectModel:
    """The thing as heavy and slippery as it truly is, which the twin does not know."""
    mass = thing.mass * (1 + simulation.mass_mismatch * rng.uniform(-1, 1))
    friction = thing.friction * (1 + simulation.friction_mismatch * rng.uniform(-1, 1))
    return replace(thing, mass=mass, friction=friction)
