"""The digital twin: what the stack believes, built from perception and the object library alone.

Perceived poses are off by millimetres, which would make things hover or explode. So every object is first set down
on whatever is under it, then what still overlaps is moved apart, then all of it settles under gravity. The result is
deterministic.
"""

import copy
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import mujoco
import numpy as np

from control.errors import ConfigError, StackError
from control.twin_model import (
    ARM_ACTUATORS,
    ARM_BODIES,
    ARM_JOINTS,
    FINGER_BODIES,
    FINGER_JOINTS,
    HAND_BODY,
    TCP_SITE,
    TwinModel,
    TwinObject,
)
from perception.estimates import ObjectEstimate, SceneEstimate
from sim_check.cells.cell_config import CellConfig
from sim_check.furniture.build import furniture_model
from sim_check.furniture.mjcf import add_furniture, set_fractions
from sim_check.furniture.model import FurnitureModel
from sim_check.models.panda_mjcf import panda_spec
from sim_check.models.scene_mjcf import (
    add_lights,
    add_object,
    add_sky,
    add_table,
    place_robot,
    pose_of,
    quat_of,
    set_rendering,
)
from sim_check.objects.library import ObjectModel
from sim_check.twin.collision_masks import without_contacts
from sim_check.twin.placed import Fixed, Standing
from sim_check.twin.seen_volume import seen_volume
from sim_check.twin.settling import free_bodies, move_apart, settle, touching
from sim_check.twin.supports import carrier, set_down, stand
from sim_check.twin.unnamed import FIXED_STD, can_be_held, model_of, overlaps, without_contacts_of

TWIN_STEP = 0.004  # [s]; coarser steps lose what the hand holds
# Furthest that moving apart and settling may carry a thing from where it was perceived and set down, in [m]; where
# there is a container, its radius is added, for a fruit may roll to its middle.
MAX_DRIFT = 0.02
# Furthest that an object in the hand is moved to lie in the middle between the pads, in [m].
MAX_RECENTRE = 0.02
# Least spreads of a perturbed twin: perception's own figures leave out calibration.
POSITION_FLOOR, YAW_FLOOR = 0.002, np.deg2rad(1.5)
DRAWS = 3  # per perturbed twin that is wanted
FRICTION_SPREAD, MASS_SPREAD, GAIN_SPREAD = 0.3, 0.3, 0.07


def build_twin(
    cell: CellConfig,
    scene: SceneEstimate,
    q: np.ndarray,
    gripper_width: float,
    held: str | None = None,
    around_arm: bool = True,
) -> TwinModel:
    """Build and settle the twin of a perceived scene.

    Args:
        cell: Where the robot stands; its simulation block is not read.
        scene: What was perceived.
        q: Arm joints that the robot holds in [rad], shape (7,).
        gripper_width: Distance between the pads in [m].
        held: Name of the object in the hand, perceived between the pads; or None.
        around_arm: Whether what overlaps the arm is moved out of it, as the arm is where it is for certain; otherwise
            things stay where they are perceived, and the arm may be inside of them (not with something in the hand).

    Returns:
        The twin at rest, at a step of `TWIN_STEP`.

    Raises:
        ConfigError: A name or size that the object library cannot build.
        StackError: `held` was not perceived or is not between the pads, or things overlap and cannot be moved apart.
    """
    opening = cell.robot.gripper_model.opening
    loose = frozenset(e.name for e in scene.objects if not e.named and can_be_held(e, opening))
    try:
        return _built(cell, scene, q, gripper_width, held, around_arm, loose)
    except StackError:
        if not loose:
            raise
        # Boxes around depth are guesses: where they cannot rest beside what was named, they stand fixed.
        return _built(cell, scene, q, gripper_width, held, around_arm, frozenset())


def _built(
    cell: CellConfig,
    scene: SceneEstimate,
    q: np.ndarray,
    gripper_width: float,
    held: str | None,
    around_arm: bool,
    loose: frozenset[str],
) -> TwinModel:
    """As `build_twin`; of the unnamed things those named in `loose` are free bodies, where they overlap nothing."""
    q = np.asarray(q, float)
    if q.shape != (7,):
        raise ConfigError(f"arm joints of a twin have shape (7,), not {q.shape}")
    if held is not None and scene.get(held) is None:
        raise StackError(f"'{held}' should be in the hand but was not perceived; perceived were {sorted(scene.names)}")
    for e in scene.objects:
        if not (np.all(np.isfinite(e.world_T_object)) and np.all(np.isfinite(e.extents))):
            raise StackError(f"the pose or the size of '{e.name}' is not finite; look again")
    if held in cell.furniture:
        raise StackError(f"'{held}' is furniture and cannot be in the hand")
    fixed = [
        _stood(furniture_model(e.name, cell.furniture[e.name]), e, scene.support_height)
        for e in scene.objects
        if e.name in cell.furniture
    ]
    things = [e for e in scene.objects if e.name not in cell.furniture]
    standing = [Standing(model_of(e, e.name in loose or e.name == held), np.array(e.world_T_object)) for e in things]
    obstacles = [s for s in standing if not s.thing.movable and s.thing.name != held]
    resting = [s for s in standing if s.thing.movable and s.thing.name != held]
    placed = set_down(resting, scene.support_height, fixed, obstacles)
    placed += obstacles + [s for s in standing if s.thing.name == held]
    models: dict[str, ObjectModel | FurnitureModel] = {s.thing.name: s.thing for s in (*placed, *fixed)}
    order = {name: i for i, name in enumerate(scene.names)}
    placed.sort(key=lambda s: order[s.thing.name])

    spec = panda_spec(meshes=False, gripper=cell.robot.gripper_model)
    place_robot(spec, cell.robot)
    spec.option.timestep = TWIN_STEP
    add_table(spec, scene.support_height)
    add_sky(spec)
    add_lights(spec)
    set_rendering(spec, 640, 480)
    for f in fixed:
        add_furniture(spec, f.thing, f.pose, pictures=False)
    for s in placed:
        add_object(spec, s.thing, s.pose, pictures=False)
    model = spec.compile()
    inside = [pair for pair in overlaps(model) if not _all_named(scene, pair)]
    pressing = loose & {name for pair in inside for name in pair}
    if pressing:
        return _built(cell, scene, q, gripper_width, held, around_arm, loose - pressing)
    if inside:
        model = without_contacts_of(spec, inside)

    twin = TwinModel(
        model=model,
        qpos=model.qpos0.copy(),
        q=q.copy(),
        gripper_width=float(gripper_width),
        held=held,
        objects=tuple(_described(e, models[e.name]) for e in scene.objects),
        support_height=scene.support_height,
        scene_stamp=scene.stamp,
        joints=tuple(joint for f in fixed for joint in f.thing.joints),
        compartments=tuple(c for f in fixed for c in f.thing.compartments),
        gripper=cell.robot.gripper_model,
    )
    qpos = _robot_qpos(twin, twin.qpos, gripper_width)
    for f in fixed:
        set_fractions(model, qpos, f.thing, f.fractions)
    if held is not None:
        qpos = _into_the_hand(twin, qpos)
    if around_arm or held is not None:
        settling = twin
    else:
        settling = without_contacts(twin, (*ARM_BODIES, HAND_BODY, *FINGER_BODIES))
    twin = replace(twin, qpos=_rest(settling, qpos))
    if scene.seen is None:
        return twin
    return replace(twin, seen=seen_volume(scene.seen, model, twin.start(), scene.support_height))


def perturbed_twin(twin: TwinModel, rng: np.random.Generator, scale: float = 1.0) -> TwinModel:
    """The twin as it might also be, given how well poses, masses, friction and servos are known.

    Positions are drawn from each object's spread (at least 2 mm) and yaws from theirs (at least 1.5 degrees), both
    cut at twice the spread; friction and mass of each object are scaled by up to 30 %, each servo's gain by up to 7 %.
    Furniture moves with what is in it or hangs on it; the dry friction and damping of its joints vary by up to 30 %.
    Things are set apart and settled again. The object in the hand stays between the pads.

    Args:
        twin: Built by `build_twin`; not changed.
        rng: Source of randomness.
        scale: Factor on all of these spreads; 0 gives the twin again.

    Raises:
        StackError: The drawn poses cannot be settled, nor can those at a half and a quarter of the drawn offsets.
    """
    return _settled(twin, *_draw(twin, rng, scale))


def _draw(twin: TwinModel, rng: np.random.Generator, scale: float) -> tuple[mujoco.MjModel, dict[str, np.ndarray]]:
    """All that is random in a perturbed twin: its model and the offset of each object, as `_draw_offset` gives it."""
    drawn = copy.copy(twin.model)
    _perturb_model(twin, drawn, rng, scale)
    return drawn, {o.name: _draw_offset(o, rng, scale) for o in twin.objects if o.name != twin.held}


def _settled(twin: TwinModel, drawn: mujoco.MjModel, offsets: dict[str, np.ndarray]) -> TwinModel:
    """The twin with a drawn model and its things moved by their offsets, at rest.

    Raises:
        StackError: The drawn poses cannot be settled, nor can those at a half and a quarter of the drawn offsets.
    """
    fixed = {o.name for o in twin.objects if not o.movable}
    carriers = carrier(twin, fixed) if fixed else {}
    # Neighbours that are drawn into each other are possible in the draw but not in the world: they are drawn nearer
    # to where they were perceived.
    for share in (1.0, 0.5, 0.25):
        model, qpos = copy.copy(drawn), twin.qpos.copy()
        for name, offset in offsets.items():
            if name in fixed:
                turn = _moved_about(model.body(name).pos, share * offset)
                _move_fixed(model, name, turn)
                for thing in (n for n, by in carriers.items() if by == name and n != twin.held):
                    _move_free(model, qpos, thing, turn)
        for name, offset in offsets.items():
            if name not in fixed:
                _shift(model, qpos, name, share * offset)
        changed = replace(twin, model=model)
        try:
            return replace(changed, qpos=_rest(changed, qpos))
        except StackError as error:
            reason = error
    raise reason


def worlds_to_try(twin: TwinModel) -> int:
    """In how many perturbed twins a plan should be tried: the less is known of where things stand, the more.

        n = 3 + 2.5 (s - 3 mm) / mm,  3 <= n <= 8

    with the largest spread s of a horizontal position. At 5 mm one plan in five fails where three twins found no fault.
    """
    worst = max((float(np.max(o.position_std[:2])) for o in twin.objects), default=0.0)
    return int(np.clip(round(3 + 2.5 * (worst * 1e3 - 3)), 3, 8))


def possible_twins(twin: TwinModel, rng: np.random.Generator, count: int, nthread: int = 1) -> list[TwinModel]:
    """Up to `count` perturbed twins.

    A draw in which things cannot come to rest is no world, so a few are made for each.

    Args:
        twin: Built by `build_twin`; not changed.
        rng: Source of randomness.
        count: How many are wanted; fewer come where most draws are impossible.
        nthread: Threads in which things settle; the twins do not depend on it.
    """
    out: list[TwinModel] = []
    left = DRAWS * count
    with ThreadPoolExecutor(max(1, nthread)) as pool:
        while len(out) < count and left > 0:
            draws = [_draw(twin, rng, 1.0) for _ in range(min(count - len(out), left))]
            left -= len(draws)
            out += [t for t in pool.map(lambda draw: _settled_if_possible(twin, *draw), draws) if t is not None]
    return out


def _settled_if_possible(twin: TwinModel, drawn: mujoco.MjModel, offsets: dict[str, np.ndarray]) -> TwinModel | None:
    try:
        return _settled(twin, drawn, offsets)
    except StackError:
        return None


def _all_named(scene: SceneEstimate, names: Sequence[str]) -> bool:
    return all(o.named for o in scene.objects if o.name in names)


def _stood(thing: FurnitureModel, estimate: ObjectEstimate, table: float) -> Fixed:
    """Furniture upright on the table where it was perceived.

    Raises:
        StackError: It was perceived lying, or a fraction belongs to no joint of it.
    """
    names = [p.name for p in thing.parts]
    for joint in estimate.joint_fractions:
        if joint not in names:
            raise StackError(f"'{thing.name}' has no joint '{joint}'; it has {names}")
    return Fixed(thing, stand(thing, np.array(estimate.world_T_object), table), dict(estimate.joint_fractions))


def _described(estimate: ObjectEstimate, thing: ObjectModel | FurnitureModel) -> TwinObject:
    if isinstance(thing, FurnitureModel):
        return TwinObject(
            name=thing.name,
            shape="box",
            extents=thing.extents,
            movable=False,
            container=False,
            inner_floor=0.0,
            inner_radius=0.0,
            position_std=np.array(estimate.position_std, float),
            yaw_std=float(estimate.yaw_std),
        )
    return TwinObject(
        name=thing.name,
        shape=estimate.shape,
        extents=thing.extents,
        movable=thing.movable,
        container=thing.container,
        inner_floor=thing.inner_floor,
        inner_radius=thing.inner_radius,
        position_std=np.minimum(estimate.position_std, np.inf if thing.movable else FIXED_STD),
        yaw_std=float(estimate.yaw_std),
        handle=thing.handle,
        doubts=estimate.doubts,
        named=estimate.named,
    )


def _robot_qpos(twin: TwinModel, qpos: np.ndarray, width: float) -> np.ndarray:
    """A configuration with the arm at the twin's joints and the pads this far apart in [m]."""
    qpos = qpos.copy()
    for name, angle in zip(ARM_JOINTS, twin.q, strict=True):
        qpos[twin.model.joint(name).qposadr[0]] = angle
    for name in FINGER_JOINTS:
        qpos[twin.model.joint(name).qposadr[0]] = np.clip(width, 0.0, twin.gripper.opening) / 2
    return qpos


def _into_the_hand(twin: TwinModel, qpos: np.ndarray) -> np.ndarray:
    """Centre the held object between the pads and set the pads to its width across them.

    The width is that of the object's surface along the hand's y axis through its middle, found with MuJoCo's distance
    between the pads and the object while the pads are wide open.
    """
    model, name, widest = twin.model, str(twin.held), twin.gripper.opening
    qpos = _robot_qpos(twin, qpos, widest)
    perceived = _position(model, qpos, name)
    data, gaps = mujoco.MjData(model), [0.0, 0.0]
    for _ in range(2):  # the second round measures again at the centred pose
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        across = data.site(TCP_SITE).xmat.reshape(3, 3)[:, 1]
        gaps = [_gap(model, data, finger, name) for finger in FINGER_BODIES]
        # The left finger opens towards +y of the hand.
        _shift_position(model, qpos, name, across * (gaps[0] - gaps[1]) / 2)
    width = widest - sum(gaps)
    moved = float(np.linalg.norm(_position(model, qpos, name) - perceived))
    if not 0.0 < width < widest or moved > MAX_RECENTRE:
        raise StackError(
            f"'{name}' should be in the hand, but as perceived it is not between the pads; open the hand, or look again"
        )
    return _robot_qpos(twin, qpos, width)


def _gap(model: mujoco.MjModel, data: mujoco.MjData, finger: str, name: str) -> float:
    """Least distance in [m] between a finger's geoms and an object's; negative when they overlap."""
    geoms = [np.flatnonzero(model.geom_bodyid == model.body(b).id) for b in (finger, name)]
    segment = np.zeros(6)
    return min(mujoco.mj_geomDistance(model, data, int(a), int(b), 0.2, segment) for a in geoms[0] for b in geoms[1])


def _rest(twin: TwinModel, qpos: np.ndarray) -> np.ndarray:
    """Configuration after moving apart and settling.

    Raises:
        StackError: Something does not come to rest, overlaps, drifts away or falls out of the hand.
    """
    model = twin.model
    data = replace(twin, qpos=qpos).start()
    before = {name: data.body(name).xpos.copy() for name in free_bodies(model)}
    move_apart(model, data, fixed=frozenset({twin.held} if twin.held else ()))
    settle(model, data)
    if twin.held is not None:
        _check_held(model, data, twin.held)
    into = max((o.inner_radius for o in twin.objects), default=0.0)
    for name, position in before.items():
        drift = float(np.linalg.norm(data.body(name).xpos - position))
        if drift > MAX_DRIFT + into:
            others = touching(model, data, name)
            against = f", against {others}" if others else ""
            raise StackError(
                f"'{name}' cannot be where it was perceived: in the twin it ends {drift * 1e3:.0f} mm from there"
                f"{against}; its pose or size is likely wrong: look again from another side"
            )
    settled = data.qpos.copy()
    if twin.held is None:
        settled = _robot_qpos(twin, settled, twin.gripper_width)
    return settled


def _check_held(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> None:
    body = model.body(name).id
    fingers = {model.body(f).id for f in FINGER_BODIES}
    against = set()
    for contact in data.contact[: data.ncon]:
        pair = {int(model.geom_bodyid[g]) for g in contact.geom}
        if body in pair:
            against |= pair & fingers
    if against != fingers:
        raise StackError(f"'{name}' does not stay between the pads in the twin; look again, or open the hand")


def _perturb_model(twin: TwinModel, model: mujoco.MjModel, rng: np.random.Generator, scale: float) -> None:
    def factor(spread: float, size: int | None = None):
        return 1.0 + scale * spread * rng.uniform(-1.0, 1.0, size)

    for thing in twin.objects:
        body = model.body(thing.name).id
        heavier, rougher = factor(MASS_SPREAD), factor(FRICTION_SPREAD)
        model.body_mass[body] *= heavier
        model.body_inertia[body] *= heavier
        model.geom_friction[model.geom_bodyid == body] *= rougher
    for joint in twin.joints:
        dof = int(model.joint(joint.name).dofadr[0])
        model.dof_frictionloss[dof] *= factor(FRICTION_SPREAD)
        model.dof_damping[dof] *= factor(FRICTION_SPREAD)
    # Contacts take the larger friction of their two geoms, and the pads' always: these vary as well.
    for geom in ("table", "left_pad", "right_pad"):
        model.geom_friction[model.geom(geom).id] *= factor(FRICTION_SPREAD)
    for actuator, gain in zip(ARM_ACTUATORS, factor(GAIN_SPREAD, len(ARM_ACTUATORS)), strict=True):
        number = model.actuator(actuator).id
        model.actuator_gainprm[number, 0] *= gain
        model.actuator_biasprm[number, 1:3] *= gain
    # Constants that the compiler derives from masses must follow them.
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _draw_offset(thing: TwinObject, rng: np.random.Generator, scale: float) -> np.ndarray:
    """(x, y) in [m] and yaw in [rad], shape (3,); heights follow from what things stand on."""
    std = np.maximum(thing.position_std[:2], POSITION_FLOOR)
    yaw_std = max(thing.yaw_std, YAW_FLOOR) if np.isfinite(thing.yaw_std) else 0.0
    drawn = np.clip(rng.standard_normal(3), -2.0, 2.0)
    return scale * np.append(std, yaw_std) * drawn


def _shift(model: mujoco.MjModel, qpos: np.ndarray, name: str, offset: np.ndarray) -> None:
    """Move a free body by (x, y) in [m] and turn it about the world's z by yaw in [rad], in place."""
    at = int(model.joint(name).qposadr[0])
    _shift_position(model, qpos, name, np.array([offset[0], offset[1], 0.0]))
    turn = pose_of(np.zeros(3), np.array([np.cos(offset[2] / 2), 0.0, 0.0, np.sin(offset[2] / 2)]))
    qpos[at + 3 : at + 7] = quat_of(turn @ pose_of(np.zeros(3), qpos[at + 3 : at + 7]))


def _moved_about(point: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """World transform, shape (4, 4): about z through a point by offset[2] [rad], then by offset[:2] [m]."""
    pose = pose_of(np.zeros(3), np.array([np.cos(offset[2] / 2), 0.0, 0.0, np.sin(offset[2] / 2)]))
    pose[:3, 3] = point - pose[:3, :3] @ point + np.array([offset[0], offset[1], 0.0])
    return pose


def _move_fixed(model: mujoco.MjModel, name: str, move: np.ndarray) -> None:
    body = model.body(name).id
    pose = move @ pose_of(model.body_pos[body], model.body_quat[body])
    model.body_pos[body], model.body_quat[body] = pose[:3, 3], quat_of(pose)


def _move_free(model: mujoco.MjModel, qpos: np.ndarray, name: str, move: np.ndarray) -> None:
    at = int(model.joint(name).qposadr[0])
    pose = move @ pose_of(qpos[at : at + 3], qpos[at + 3 : at + 7])
    qpos[at : at + 3], qpos[at + 3 : at + 7] = pose[:3, 3], quat_of(pose)


def _position(model: mujoco.MjModel, qpos: np.ndarray, name: str) -> np.ndarray:
    at = int(model.joint(name).qposadr[0])
    return qpos[at : at + 3].copy()


def _shift_position(model: mujoco.MjModel, qpos: np.ndarray, name: str, offset: np.ndarray) -> None:
    at = int(model.joint(name).qposadr[0])
    qpos[at : at + 3] += offset
