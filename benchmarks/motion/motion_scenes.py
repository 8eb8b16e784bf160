"""Scenes and reward specs of the motion benchmark: one subtask of the benchmark's cells each, drawn by a seed.

The truth of a seeded simulated cell becomes an estimate, exact or with errors; the planner gets a twin of the estimate
and nothing else. What was learnt before a subtask (a door that was opened, a kettle that was put away) is set here as
the start, and no locks are among it: these are motions alone.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.scenes.estimates import estimate, exact_scene, with_errors
from control.robot.limits import REST_Q
from control.tasks.reward_spec import PALM, RewardSpec, RewardTerm
from control.twin_model import TwinModel
from perception.estimates import SceneEstimate
from sim_check.cells.loading import load_cell
from sim_check.twin.twin import build_twin, perturbed_twin
from sim_check.world.world import build_world

OPEN_WIDTH = 0.08  # [m]
# Of the model mismatch: largest errors of furniture in [m], of loose things in [m] and [rad].
FURNITURE_OFF, THING_OFF, THING_TURNED = 0.005, 0.004, np.deg2rad(4.0)


def spec_of(kind: str, subject: str, target: str | None = None, value: float | None = None) -> RewardSpec:
    """One primary term and, where an object is handled, the palm's way to it."""
    primary = RewardTerm(kind, subject, target, value, primary=True)
    if kind == "set_joint_fraction":
        return RewardSpec((primary,))
    return RewardSpec((RewardTerm("minimize_l2_distance", PALM, subject), primary))


def _sides(left: RewardSpec, right: RewardSpec) -> Callable[[int], RewardSpec]:
    return lambda seed: left if seed % 2 == 0 else right


@dataclass(frozen=True)
class MotionTask:
    """One subtask.

    Attributes:
        cell: Built-in cell.
        spec: What to achieve, by seed.
        gone: Objects that were taken away before.
        opened: Joint fractions at the start.
        moved: Objects that stand elsewhere at the start: position on the table in [m], (x, y).
    """

    cell: str
    spec: Callable[[int], RewardSpec]
    gone: tuple[str, ...] = ()
    opened: Mapping[str, float] | None = None
    moved: Mapping[str, tuple[float, float]] | None = None


LEFT, RIGHT = "wooden_cabinet_left_door", "wooden_cabinet_right_door"
MOTIONS: dict[str, MotionTask] = {
    "open_door": MotionTask(
        "cabinet-closed",
        _sides(spec_of("set_joint_fraction", LEFT, value=1.0), spec_of("set_joint_fraction", RIGHT, value=1.0)),
    ),
    "close_door": MotionTask(
        "cabinet-open",
        _sides(spec_of("set_joint_fraction", LEFT, value=0.0), spec_of("set_joint_fraction", RIGHT, value=0.0)),
    ),
    "remove_bar": MotionTask(
        "cabinet-blocked", lambda _: spec_of("maximize_l2_distance", "red_bar", "wooden_cabinet", 0.5)
    ),
    "pull_lever": MotionTask("cabinet-locked", lambda _: spec_of("set_joint_fraction", "lever_rod", value=1.0)),
    "remove_kettle": MotionTask(
        "kitchen-explore", lambda _: spec_of("maximize_l2_distance", "kettle", "microwave", 0.5)
    ),
    "open_microwave": MotionTask(
        "kitchen-explore",
        lambda _: spec_of("set_joint_fraction", "microwave_door", value=1.0),
        gone=("kettle",),
    ),
    "slide_door": MotionTask(
        "composite-explore", lambda _: spec_of("set_joint_fraction", "stone_cabinet_door", value=1.0)
    ),
    "cube_on_crate": MotionTask("cubes-color", lambda _: spec_of("minimize_l2_distance", "red_cube", "red_crate")),
    "cube_on_plate": MotionTask(
        "composite-explore",
        lambda _: spec_of("minimize_l2_distance", "red_cube", "weight_sensor"),
        moved={"red_cube": (0.40, -0.22)},
    ),
    "place_in_cabinet": MotionTask(
        "cabinet-open", lambda _: spec_of("minimize_l2_distance", "yellow_cube", "wooden_cabinet")
    ),
    "lift": MotionTask("cubes", lambda _: spec_of("set_obj_z_position", "red_cube", value=0.25)),
    "turn": MotionTask("cubes", lambda _: spec_of("set_obj_orientation", "red_cube", value=np.pi / 2)),
}


# A bar is taken out from behind the handles, both doors are opened, the cube is put inside.
CHAIN_CELL = "cabinet-blocked"
CHAIN = (
    spec_of("maximize_l2_distance", "red_bar", "wooden_cabinet", 0.5),
    spec_of("set_joint_fraction", LEFT, value=1.0),
    spec_of("set_joint_fraction", RIGHT, value=1.0),
    spec_of("minimize_l2_distance", "yellow_cube", "wooden_cabinet"),
)


@dataclass(frozen=True)
class Scene:
    """A subtask of one seed.

    Attributes:
        spec: What to achieve.
        believed: What the planner gets.
        true: Where its motion is judged.
    """

    spec: RewardSpec
    believed: TwinModel
    true: TwinModel


def draw_scene(task: MotionTask, seed: int, pose_noise: float = 0.0, mismatch: bool = False) -> Scene:
    """Draw a seeded scene.

    Args:
        task: Which subtask.
        seed: Source of placements, of errors and of mismatch.
        pose_noise: Spread of perceived positions along each axis in [m], normal, cut at twice of it; yaws err as such
            errors at the ends of a thing turn it, by 0.4 degrees a millimetre at most, joint fractions by 0.001 a
            millimetre.
        mismatch: Whether the true model differs from the believed one: furniture by up to 5 mm, things by up to 4 mm
            and 4 degrees, friction and mass by 30 %, joint gains by 7 % (normal or uniform, cut there).

    Raises:
        StackError: What is perceived cannot stand like that.
    """
    cell = load_cell(task.cell)
    q = np.array(REST_Q)
    exact, rng = draw_estimate(task, seed)
    true = build_twin(cell, exact, q, OPEN_WIDTH)
    believed = true
    if pose_noise > 0.0:
        millimetres = pose_noise * 1e3
        seen = with_errors(exact, rng, pose_noise, 0.4 * millimetres, 0.001 * millimetres, by_size=True)
        believed = build_twin(cell, seen, q, OPEN_WIDTH)
    if mismatch:
        true = _mismatched(true, rng)
    return Scene(task.spec(seed), believed, true)


def draw_estimate(task: MotionTask, seed: int) -> tuple[SceneEstimate, np.random.Generator]:
    """What a perfect perception would say of a seeded scene, and the source of whatever else is drawn for it."""
    world = build_world(load_cell(task.cell), seed, meshes=False)
    rng = np.random.default_rng([seed, 20])
    return _as_found(exact_scene(world, without=task.gone), task, rng), rng


def draw_twin(cell: str, seed: int) -> TwinModel:
    """A twin of the true poses of a seeded cell."""
    config = load_cell(cell)
    exact = exact_scene(build_world(config, seed, meshes=False))
    return build_twin(config, exact, np.array(REST_Q), OPEN_WIDTH)


def _as_found(scene: SceneEstimate, task: MotionTask, rng: np.random.Generator) -> SceneEstimate:
    """The scene as earlier subtasks left it."""
    objects = []
    for e in scene.objects:
        if task.opened and any(name in task.opened for name in e.joint_fractions):
            e = replace(e, joint_fractions={**e.joint_fractions, **task.opened})
        if task.moved and e.name in task.moved:
            spread = rng.uniform(-0.03, 0.03, 2)
            x, y = np.array(task.moved[e.name]) + spread
            turn = float(rng.uniform(-0.35, 0.35))
            e = estimate(e.name, (x, y, e.extents[2] / 2), e.extents, e.shape, turn)
        objects.append(e)
    return replace(scene, objects=tuple(objects))


def _mismatched(twin: TwinModel, rng: np.random.Generator) -> TwinModel:
    """A model that differs from the twin, as drawn by its own perturbation with the mismatch's spreads."""
    fixed = {o.name for o in twin.objects if not o.movable}
    objects = tuple(
        replace(
            o,
            position_std=np.full(3, (FURNITURE_OFF if o.name in fixed else THING_OFF) / 2),
            yaw_std=np.inf if o.name in fixed or not np.isfinite(o.yaw_std) else THING_TURNED / 2,
        )
        for o in twin.objects
    )
    drawn = perturbed_twin(replace(twin, objects=objects), rng)
    return replace(drawn, objects=twin.objects)
