"""Pictures of random cells with their truth: random things, colours, lights, cameras, surfaces and clutter.

For training detectors and for measuring perception. One pool of things is compiled into one model and its arrays are
rewritten for every scene, which is a hundred times faster than compiling each. Like a simulated cell's `World`, this
holds the truth: only scorers and what labels training pictures may look at it.

No physics: things stand on the table, on each other or in a bowl by construction.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.robot.limits import REST_Q
from control.twin_model import ARM_BODIES, ARM_JOINTS
from perception.catalogue.catalogue import Catalogue, builtin_catalogue
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.ground_truth import FrameTruth, TrueObject
from sim_check.cells.simulation_config import DepthNoiseConfig
from sim_check.furniture.mjcf import add_furniture
from sim_check.furniture.model import FurnitureModel
from sim_check.models.panda_mjcf import PICTURE_GROUP, panda_spec
from sim_check.models.render import Offscreen
from sim_check.models.scene_mjcf import add_object, set_rendering
from sim_check.objects.library import ROLLING, TORSION, ObjectModel
from sim_check.objects.solids import SolidShape
from sim_check.random_scenes.room import Room, add_random_room
from sim_check.random_scenes.silhouettes import silhouette_area
from sim_check.random_scenes.things import RandomThing, drawn_nouns, random_furniture, random_thing, shade
from sim_check.world.depth_noise import stereo_depth

HIDDEN_GROUP = 5  # geoms of this group are not drawn
EYE = "eye"
LARGE = 0.3  # things longer than this are looked at from their front and from further away, in [m]
MIDDLE = np.array([0.45, 0.0])  # of the part of the table that things stand on, in [m]


@dataclass(frozen=True)
class SceneOptions:
    """What is drawn, and how it is looked at.

    Attributes:
        width, height: Of the pictures in [px].
        focal: Range of the focal length of a picture 640 px wide in [px].
        distance: Range of the camera's distance from the middle of the scene in [m].
        elevation_deg: Range of the camera's height above the horizon in [degrees].
        most_things: Most things of the library in a scene.
        clutter: Most solids that no phrase asks for.
        furniture_share, robot_share: How often there is furniture, or a robot, 0..1.
        repeats: Whether a scene may hold two things of the same name.
        scenes_per_pool, views_per_scene: How often a compiled pool, and an arrangement, is used.
        depth_noise: Of the cameras; None for perfect depth.
        least_share: Things of which less is visible are neither asked for nor called absent, 0..1.
        least_px: The same for visible pixels of a picture 640 px wide.
    """

    width: int = 640
    height: int = 480
    focal: tuple[float, float] = (480.0, 640.0)
    distance: tuple[float, float] = (0.4, 1.4)
    elevation_deg: tuple[float, float] = (18.0, 78.0)
    most_things: int = 8
    clutter: int = 4
    furniture_share: float = 0.35
    robot_share: float = 0.25
    repeats: bool = False
    scenes_per_pool: int = 12
    views_per_scene: int = 2
    depth_noise: DepthNoiseConfig | None = field(default_factory=DepthNoiseConfig)
    least_share: float = 0.35
    least_px: int = 110


@dataclass(frozen=True)
class Seen:
    """One thing in a picture.

    Attributes:
        thing: What it is.
        label: Its number in the label picture.
        world_T_object: Pose of its box centre, shape (4, 4).
        box_px: Around its visible pixels, (x0, y0, x1, y1), ints, shape (4,).
        pixels: How many are visible.
        visible_share: Over those that its silhouette would cover, also outside of the picture, 0..1.
        joint_fractions: Of furniture.
        clear: Whether enough of it is visible to ask for it.
    """

    thing: RandomThing
    label: int
    world_T_object: NDArray[np.float64]
    box_px: NDArray[np.int64]
    pixels: int
    visible_share: float
    joint_fractions: dict[str, float]
    clear: bool


@dataclass(frozen=True)
class LabelledPicture:
    """One picture and what it shows.

    Attributes:
        colour: RGB, uint8, shape (height, width, 3).
        depth: True distance along the optical axis in [m], float32, shape (height, width), NaN where nothing is.
        labels: 0 background, else `Seen.label`, uint8, shape (height, width).
        seen: Everything of the library that shows at least one pixel.
        intrinsics: Of the pictures.
        world_T_camera: Optical frame, shape (4, 4).
    """

    colour: NDArray[np.uint8]
    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    seen: tuple[Seen, ...]
    intrinsics: CameraIntrinsics
    world_T_camera: NDArray[np.float64]


class RandomScenes:
    """An endless row of labelled pictures; the same seed and options give the same row."""

    def __init__(
        self,
        seed: int,
        options: SceneOptions | None = None,
        mesh_cache: Path | None = None,
        catalogue: Catalogue | None = None,
    ) -> None:
        """Nothing is built before the first picture.

        Args:
            seed: Of everything random.
            options: What is drawn.
            mesh_cache: Folder in which the robot's converted meshes are kept.
            catalogue: What may be drawn, and how; the built-in one if None.
        """
        self.catalogue = catalogue or builtin_catalogue()
        self.options = options or SceneOptions()
        scene_seed, noise_seed = np.random.SeedSequence(seed).spawn(2)
        self._rng, self._noise_rng = np.random.default_rng(scene_seed), np.random.default_rng(noise_seed)
        self._mesh_cache = mesh_cache
        self._pool: _Pool | None = None
        self._count = 0

    def picture(self, distance: float | None = None) -> LabelledPicture:
        """The next picture.

        Args:
            distance: Of the camera from the middle of the scene in [m]; drawn if None.

        Raises:
            MachineError: No way to render on this machine.
        """
        o = self.options
        per_pool = o.scenes_per_pool * o.views_per_scene
        if self._pool is None or self._count % per_pool == 0:
            self.close()
            self._pool = _Pool(self._rng, o, self._mesh_cache, self.catalogue)
        if self._count % o.views_per_scene == 0:
            self._pool.arrange()
        self._count += 1
        return self._pool.look(distance)

    def frame(self, distance: float | None = None) -> tuple[RgbdFrame, FrameTruth]:
        """The next picture as a camera with stereo noise delivers it, and its truth."""
        picture = self.picture(distance)
        depth = picture.depth
        if self.options.depth_noise is not None:
            depth = stereo_depth(depth, picture.intrinsics.fx, self.options.depth_noise, self._noise_rng)
        frame = RgbdFrame(
            picture.colour, depth, picture.intrinsics, picture.world_T_camera, float(self._count), "random"
        )
        return frame, truth_of(picture, self.catalogue)

    def close(self) -> None:
        """Free what the graphics driver holds."""
        if self._pool is not None:
            self._pool.renderer.close()
            self._pool = None


def truth_of(picture: LabelledPicture, catalogue: Catalogue) -> FrameTruth:
    """What can fairly be asked about a picture: its clear things by name, and names of what is certainly absent."""
    clear = [s for s in picture.seen if s.clear]
    objects, used = [], set()
    for s in clear:
        name = name_in(s.thing, [o.thing for o in picture.seen])
        if name in used:
            continue
        used.add(name)
        objects.append(
            TrueObject(
                name,
                s.world_T_object,
                s.thing.extents,
                s.thing.shape,
                picture.labels == s.label,
                s.box_px.astype(float),
                s.visible_share,
                s.joint_fractions,
            )
        )
    absent = [
        noun if colour == noun else f"{colour}_{noun}"
        for noun in drawn_nouns(catalogue)
        for colour in catalogue.painted_words
        if not any(s.thing.may_fit(noun, colour) for s in picture.seen)
    ]
    return FrameTruth(tuple(objects), tuple(absent))


def name_in(thing: RandomThing, all_things: Sequence[RandomThing]) -> str:
    """What people would call a thing among others: "lemon" where the colour says nothing, else "red_cube"."""
    noun = thing.nouns[0]
    alone = not any(t is not thing and t.may_fit(noun, None) for t in all_things)
    if noun == thing.colour or (alone and thing.colour in thing.unsaid_colours):
        return noun
    return f"{thing.colour}_{noun}"


class _Pool:
    """One compiled model whose arrays are rewritten for every scene."""

    def __init__(
        self, rng: np.random.Generator, options: SceneOptions, mesh_cache: Path | None, catalogue: Catalogue
    ) -> None:
        self._rng, self._options, self._catalogue = rng, options, catalogue
        self._things = [random_thing(rng, f"thing{i}", catalogue) for i in range(2 * options.most_things)]
        if rng.random() < 2 * options.furniture_share:
            self._things.append(random_furniture(rng, "furniture", catalogue))
        robot = rng.random() < options.robot_share
        spec = panda_spec(meshes=True, mesh_cache=mesh_cache) if robot else mujoco.MjSpec()
        room = add_random_room(spec, rng)
        for thing in self._things:
            if isinstance(thing.model, FurnitureModel):
                add_furniture(spec, thing.model, np.eye(4), pictures=True)
            else:
                add_object(spec, thing.model, np.eye(4), pictures=True)
        clutter = [_clutter(rng, f"clutter{i}", catalogue) for i in range(2 * options.clutter)]
        for piece in clutter:
            add_object(spec, piece, np.eye(4), pictures=True)
        spec.worldbody.add_camera(
            name=EYE,
            resolution=[options.width, options.height],
            sensor_size=[options.width * 1e-5, options.height * 1e-5],
            focal_pixel=[options.width, options.width],
        )
        set_rendering(spec, options.width, options.height)
        spec.visual.quality.shadowsize = 1024
        spec.visual.quality.offsamples = 4 if rng.random() < 0.6 else 0
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._clutter = clutter
        self._robot = robot
        self._room = Room(self._model, room, rng)
        self.renderer = Offscreen(self._model, options.width, options.height)
        self._groups = self._model.geom_group.copy()
        self._shown: list[tuple[RandomThing, np.ndarray, dict[str, float]]] = []
        self._paint = self._painted_geoms()

    def _painted_geoms(self) -> dict[str, tuple[list[int], list[int]]]:
        """Geoms of every thing's bodies that cameras see, and all of its geoms, by the name of its body."""
        bodies: dict[int, str] = {}
        names = [t.model.name for t in self._things] + [c.name for c in self._clutter]
        for name in names:
            bodies[self._model.body(name).id] = name
        for thing in self._things:
            if isinstance(thing.model, FurnitureModel):
                for part in thing.model.parts:
                    bodies[self._model.body(part.name).id] = thing.model.name
        found: dict[str, tuple[list[int], list[int]]] = {name: ([], []) for name in names}
        for geom, body in enumerate(self._model.geom_bodyid):
            name = bodies.get(int(body))
            if name is not None:
                found[name][1].append(geom)
                if self._groups[geom] == PICTURE_GROUP:
                    found[name][0].append(geom)
        return found

    def arrange(self) -> None:
        """Draw a new scene: surfaces, lights, what is there, where, and in which colour."""
        rng, model, o = self._rng, self._model, self._options
        self._room.renew(self.renderer)
        model.geom_group[:] = self._groups
        for name in self._paint:
            self._show(name, False)
        self._shown = []
        placed: list[tuple[np.ndarray, float]] = []
        furniture = [t for t in self._things if isinstance(t.model, FurnitureModel)]
        if furniture and rng.random() < 0.6:
            self._stand_furniture(furniture[0], placed)
        carriers: list[tuple[RandomThing, np.ndarray]] = []
        things = [t for t in self._things if isinstance(t.model, ObjectModel)]
        wanted = int(rng.integers(1, o.most_things + 1))
        names: set[tuple[str, str]] = {(t.colour, n) for t, _, _ in self._shown for n in t.nouns}
        for i in rng.permutation(len(things)):
            if len(self._shown) >= wanted:
                break
            thing = self._repaint(things[i])
            if not o.repeats and any((thing.colour, n) in names for n in thing.nouns):
                continue
            pose = self._pose(thing, placed, carriers)
            if pose is None:
                continue
            names |= {(thing.colour, n) for n in thing.nouns}
            self._place(thing.model.name, pose)
            self._shown.append((thing, pose, {}))
        for piece in self._clutter:
            if rng.random() < 0.5:
                self._scatter(piece, placed)
        if self._robot:
            for joint, angle in zip(ARM_JOINTS, REST_Q, strict=True):
                self._data.joint(joint).qpos[:] = angle + rng.normal(0.0, 0.25)
            base = model.body(ARM_BODIES[0]).id
            away = rng.uniform(-0.15, 0.05)
            model.body_pos[base] = (away, rng.uniform(-0.2, 0.2), 0.0)
        mujoco.mj_kinematics(model, self._data)
        mujoco.mj_comPos(model, self._data)

    def _show(self, name: str, visible: bool) -> None:
        self._model.geom_group[self._paint[name][0]] = PICTURE_GROUP if visible else HIDDEN_GROUP

    def _place(self, name: str, pose: np.ndarray) -> None:
        body = self._model.body(name).id
        self._model.body_pos[body] = pose[:3, 3]
        mujoco.mju_mat2Quat(self._model.body_quat[body], np.ascontiguousarray(pose[:3, :3]).ravel())
        self._show(name, True)

    def _repaint(self, thing: RandomThing) -> RandomThing:
        """The thing in a fresh shade of its colour, written into the model."""
        model = self._model
        assert isinstance(thing.model, ObjectModel)
        old, new = np.array(thing.model.rgb), np.array(shade(self._rng, thing.colour, self._catalogue))
        ratio = new / np.maximum(old, 1e-3)
        for geom in self._paint[thing.model.name][0]:
            material = model.geom_matid[geom]
            if material >= 0:
                model.mat_rgba[material, :3] = new
                model.mat_specular[material] = self._rng.uniform(0.0, 0.7)
                model.mat_shininess[material] = self._rng.uniform(0.1, 0.8)
            elif thing.model.visual == "boards":  # painted board by board
                model.geom_rgba[geom, :3] = np.clip(model.geom_rgba[geom, :3] * ratio, 0.0, 1.0)
        painted = replace(thing, model=replace(thing.model, rgb=tuple(new)))
        self._things[self._things.index(thing)] = painted
        return painted

    def _free_spot(self, radius: float, placed: list[tuple[np.ndarray, float]], reach: float) -> np.ndarray | None:
        for _ in range(20):
            spot = MIDDLE + self._rng.uniform(-reach, reach, 2)
            if all(np.hypot(*(spot - other)) > 0.93 * (radius + r) for other, r in placed):
                placed.append((spot, radius))
                return spot
        return None

    def _pose(self, thing, placed, carriers) -> np.ndarray | None:
        """A place on the table, or on or in something that stands already."""
        rng = self._rng
        yaw = rng.uniform(-np.pi, np.pi)
        height = float(thing.extents[2])
        flat = thing.extents.copy()
        if thing.lies > 0 and rng.random() < thing.lies:
            return self._lying(thing, placed, yaw)
        if carriers and flat[:2].max() < 0.1 and rng.random() < 0.45:
            k = int(rng.integers(len(carriers)))
            below, pose = carriers[k]
            inside = below.carries == "inside"
            room = below.model.inner_radius * 0.75 if inside else float(below.extents[:2].min()) / 2
            if thing.radius <= room:
                carriers.pop(k)
                floor = pose[2, 3] - below.extents[2] / 2 + (below.model.inner_floor if inside else below.extents[2])
                shift = rng.uniform(-1, 1, 2) * max(0.0, room - thing.radius) * 0.5
                return _upright(np.array([*(pose[:2, 3] + shift), floor + height / 2]), yaw)
        spot = self._free_spot(thing.radius, placed, 0.30)
        if spot is None:
            return None
        pose = _upright(np.array([*spot, height / 2]), yaw)
        if thing.carries is not None and flat[:2].min() > 0.05:
            carriers.append((thing, pose))
        return pose

    def _lying(self, thing, placed, yaw: float) -> np.ndarray | None:
        spot = self._free_spot(float(thing.extents.max()) / 2, placed, 0.30)
        if spot is None:
            return None
        pose = _upright(np.array([*spot, float(thing.extents[0]) / 2]), yaw)
        pose[:3, :3] = pose[:3, :3] @ np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        return pose

    def _stand_furniture(self, thing: RandomThing, placed: list[tuple[np.ndarray, float]]) -> None:
        rng, model = self._rng, self._model
        assert isinstance(thing.model, FurnitureModel)
        spot = MIDDLE + rng.uniform(-0.18, 0.18, 2)
        pose = _upright(np.array([*spot, thing.extents[2] / 2]), rng.uniform(-np.pi, np.pi))
        placed.append((spot, thing.radius))
        self._place(thing.model.name, pose)
        fractions = {}
        for part in thing.model.parts:
            fraction = float(rng.choice([0.0, rng.random(), rng.random()]))
            fractions[part.name] = fraction
            self._data.qpos[model.joint(part.name).qposadr[0]] = fraction * part.opened
        self._shown.append((thing, pose, fractions))

    def _scatter(self, piece: ObjectModel, placed: list[tuple[np.ndarray, float]]) -> None:
        """Put a nameless solid on the table or, larger, somewhere around it."""
        rng, model = self._rng, self._model
        for geom in self._paint[piece.name][0]:
            material = model.geom_matid[geom]
            if material >= 0:
                model.mat_rgba[material, :3] = rng.uniform(0.05, 1.0, 3)
        spot = self._free_spot(piece.footprint_radius, placed, 0.40)
        if spot is not None:
            self._place(piece.name, _upright(np.array([*spot, piece.extents[2] / 2]), rng.uniform(-np.pi, np.pi)))

    def look(self, distance: float | None) -> LabelledPicture:
        """Draw a camera and render what it sees."""
        rng, o = self._rng, self._options
        size = (o.width, o.height)
        focal = rng.uniform(*o.focal) * o.width / 640.0
        away = rng.uniform(*o.distance) if distance is None else distance
        world_T_camera = self._camera_pose(away)
        camera = self._model.camera(EYE).id
        self._model.cam_pos[camera] = world_T_camera[:3, 3]
        turn = np.ascontiguousarray(world_T_camera[:3, :3] @ np.diag([1.0, -1.0, -1.0]))
        mujoco.mju_mat2Quat(self._model.cam_quat[camera], turn.ravel())
        self._model.cam_intrinsic[camera] = (focal * 1e-5, focal * 1e-5, 0.0, 0.0)
        mujoco.mj_camlight(self._model, self._data)
        colour = self.renderer.colour(self._data, EYE, *size)
        depth, geoms = self.renderer.depth_and_geoms(self._data, EYE, *size)
        table = np.zeros(self._model.ngeom + 1, np.uint8)
        for label, (thing, _, _) in enumerate(self._shown, 1):
            table[self._paint[thing.model.name][1]] = label
        labels = table[geoms]  # -1, nothing, reads the last entry: 0
        lens = CameraIntrinsics(*size, focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2)
        seen = tuple(
            s
            for label, shown in enumerate(self._shown, 1)
            if (s := self._seen(labels, label, shown, lens, world_T_camera)) is not None
        )
        return LabelledPicture(colour, depth, labels, seen, lens, world_T_camera)

    def _camera_pose(self, away: float) -> np.ndarray:
        """Optical frame of a camera that looks at somewhere near the things; a little rolled."""
        rng = self._rng
        middle = np.array([*MIDDLE, 0.04])
        if self._shown and rng.random() < 0.7:
            middle = self._shown[int(rng.integers(len(self._shown)))][1][:3, 3] * 0.7 + middle * 0.3
        target = middle + rng.normal(0.0, 0.06 * away, 3)
        azimuth, elevation = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(*self._options.elevation_deg))
        large = [pose for thing, pose, _ in self._shown if thing.extents.max() > LARGE]
        if large:  # nobody looks at the back of a cabinet, or stands in it
            azimuth = np.arctan2(-large[0][1, 0], -large[0][0, 0]) + rng.uniform(-1.2, 1.2)
            away = max(away, 0.5) + 0.3
        back = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
        forward = -back
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        roll = rng.normal(0.0, 0.06)
        right, down = np.cos(roll) * right + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * right
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, down, forward], -1)
        pose[:3, 3] = target + away * back
        pose[2, 3] = max(pose[2, 3], 0.12)
        return pose

    def _seen(self, labels, label: int, shown, lens: CameraIntrinsics, world_T_camera: np.ndarray) -> Seen | None:
        thing, pose, fractions = shown
        mask = labels == label
        pixels = int(mask.sum())
        if pixels == 0:
            return None
        columns, rows = np.nonzero(mask.any(0))[0], np.nonzero(mask.any(1))[0]
        box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])
        whole = silhouette_area(thing.model, pose, fractions, lens, world_T_camera)
        share = float(np.clip(pixels / max(whole, 1.0), 0.0, 1.0))
        least = self._options.least_px * (lens.width / 640.0) ** 2
        clear = share >= self._options.least_share and pixels >= least
        return Seen(thing, label, pose, box, pixels, share, fractions, clear)


def _upright(position: np.ndarray, yaw: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = position
    return pose


def _clutter(rng: np.random.Generator, name: str, catalogue: Catalogue) -> ObjectModel:
    """A solid that no noun of the library describes: a slab, a rod, a disc, an odd block."""
    kind = str(rng.choice(["slab", "rod", "disc", "wedge"]))
    if kind == "slab":
        size = np.array([rng.uniform(0.06, 0.25), rng.uniform(0.05, 0.2), rng.uniform(0.003, 0.012)])
    elif kind == "disc":
        wide = rng.uniform(0.05, 0.2)
        size = np.array([wide, wide, rng.uniform(0.004, 0.012)])
    elif kind == "rod":
        wide = rng.uniform(0.006, 0.014)
        size = np.array([wide, wide, rng.uniform(0.12, 0.3)])
    else:
        size = np.array([rng.uniform(0.01, 0.03), rng.uniform(0.05, 0.1), rng.uniform(0.12, 0.25)])
    solid: Sequence[SolidShape] = (SolidShape("cylinder" if kind in ("disc", "rod") else "box", size / 2),)
    if kind == "wedge" and rng.random() < 0.5:
        solid = (
            SolidShape("capsule", np.array([0.012, 0.012, size[2] / 2 - 0.012])),
            SolidShape("box", np.array([size[1] / 2, 0.008, 0.01]), np.array([0.0, 0.0, size[2] / 4])),
        )
    friction = np.array([catalogue.unknown.friction, TORSION, ROLLING])
    return ObjectModel(
        name=name,
        noun=None,
        shape="box",
        extents=size,
        solids=tuple(solid),
        mass=0.1,
        friction=friction,
        rolls=False,
        movable=False,
        container=False,
        inner_floor=0.0,
        inner_radius=0.0,
        rgb=tuple(rng.uniform(0.05, 1.0, 3)),  # type: ignore[arg-type]
    )
