"""Where things stand in a simulated cell: seeded draws of what the cell's placements allow."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from control.errors import ConfigError
from perception.catalogue.catalogue import builtin_catalogue
from sim_check.cells.cell_config import CellConfig, PlacementConfig, SimulationConfig
from sim_check.furniture.build import furniture_model
from sim_check.furniture.doors import stand_off_top
from sim_check.furniture.model import FurnitureModel
from sim_check.models.scene_mjcf import pose_of
from sim_check.objects.library import ObjectModel, object_model

_TRIES = 500
_AIR = 5e-4  # gap under things when they are put down, in [m]


@dataclass(frozen=True)
class Arrangement:
    """What stands where.

    Attributes:
        objects: Loose things and their poses in the world, shape (4, 4).
        furniture: Fixed things and theirs.
        fractions: How far joints of furniture are open, 0 closed .. 1 open, by joint.
    """

    objects: tuple[tuple[ObjectModel, np.ndarray], ...]
    furniture: tuple[tuple[FurnitureModel, np.ndarray], ...]
    fractions: dict[str, float]


def arrange(cell: CellConfig, simulation: SimulationConfig, rng: np.random.Generator) -> Arrangement:
    """Draw everything: whole arrangements are drawn until nothing on the table is too near to another.

    Args:
        cell: For its options and its furniture.
        simulation: Placements.
        rng: Source of randomness.

    Raises:
        ConfigError: A thing's support is missing, or things do not fit.
    """
    present = [p for p in simulation.placements if p.only_if is None or cell.options[p.only_if]]
    things = {p.object: _sized(p, rng) for p in present if p.object not in cell.furniture}
    fixed = {
        p.object: _coloured(furniture_model(p.object, cell.furniture[p.object]), p, rng)
        for p in present
        if p.object in cell.furniture
    }
    _check_supports(cell, present, things, fixed)
    fractions = {name: value for p in present for name, value in _fractions(p, rng).items()}
    on_table = [p for p in present if p.support is None]
    for _ in range(_TRIES):
        poses: dict[str, np.ndarray] = {}
        for p in present:
            poses[p.object] = _draw_pose(p, things, fixed, poses, rng)
        outlines = [_outline(p.object, things, fixed, poses) for p in on_table]
        if all(_distance(a, b) >= simulation.gap for i, a in enumerate(outlines) for b in outlines[:i]):
            return Arrangement(
                tuple((thing, poses[name]) for name, thing in things.items()),
                tuple((thing, poses[name]) for name, thing in fixed.items()),
                fractions,
            )
    raise ConfigError(
        f"cell '{cell.name}': {', '.join(p.object for p in on_table)} do not fit with a gap of {simulation.gap} m in "
        f"{_TRIES} tries; widen their spread or lower simulation.gap"
    )


def _check_supports(
    cell: CellConfig, present: list[PlacementConfig], things: dict[str, ObjectModel], fixed: dict[str, FurnitureModel]
) -> None:
    for p in present:
        if p.support is not None and p.support not in things and p.support not in fixed:
            raise ConfigError(f"cell '{cell.name}': '{p.object}' needs '{p.support}', which its options leave out")
        if p.lies_in in things and not things[p.lies_in].container:
            raise ConfigError(f"cell '{cell.name}': '{p.object}' lies in '{p.lies_in}', which is no container")
        if p.lies_in in fixed and not fixed[p.lies_in].compartments:
            raise ConfigError(f"cell '{cell.name}': '{p.object}' lies in '{p.lies_in}', which has no inside")
        behind = p.lies_behind_handles_of
        if behind is not None and not _hinged(fixed[behind]):
            raise ConfigError(f"cell '{cell.name}': '{p.object}' lies behind handles of '{behind}', which has none")


def _hinged(thing: FurnitureModel) -> list:
    return [p for p in thing.parts if p.handle is not None and thing.compartments]


def _sized(placement: PlacementConfig, rng: np.random.Generator) -> ObjectModel:
    extents = None if placement.extents is None else np.asarray(placement.extents)
    extents = object_model(placement.object, extents, "box").extents
    thing = object_model(placement.object, extents * (1 + placement.size_spread * rng.uniform(-1, 1)), "box")
    if placement.mass is not None:
        thing = replace(thing, mass=placement.mass)
    if placement.colours:
        thing = replace(thing, rgb=builtin_catalogue().paints[str(rng.choice(placement.colours))])
    return thing


def _coloured(thing: FurnitureModel, placement: PlacementConfig, rng: np.random.Generator) -> FurnitureModel:
    if not placement.colours:
        return thing
    colour = str(rng.choice(placement.colours))
    return replace(thing, rgb=builtin_catalogue().paints[colour], wooden=colour == "wood")


def _fractions(placement: PlacementConfig, rng: np.random.Generator) -> dict[str, float]:
    return {
        name: float(np.clip(value + placement.joint_spread * rng.uniform(-1, 1), 0.0, 1.0)) if value > 0 else 0.0
        for name, value in placement.joints.items()
    }


def _draw_pose(
    placement: PlacementConfig,
    things: dict[str, ObjectModel],
    fixed: dict[str, FurnitureModel],
    poses: dict[str, np.ndarray],
    rng: np.random.Generator,
) -> np.ndarray:
    """A pose in the world; that of what carries it is known already."""
    local = np.append(np.asarray(placement.position) + np.asarray(placement.spread) * rng.uniform(-1, 1, 2), 0.0)
    spread = placement.yaw_spread_deg
    if spread is None:
        aligned = placement.object in fixed or placement.lies_behind_handles_of is not None
        spread = 0.0 if aligned else 180.0
    yaw = np.deg2rad(placement.yaw_deg + spread * rng.uniform(-1, 1))
    if placement.object in fixed:
        local[2] = fixed[placement.object].extents[2] / 2
    else:
        local[2] = things[placement.object].extents[2] / 2 + _AIR
    offset = _support_point(placement, things, fixed)
    if placement.lies_behind_handles_of is not None:
        yaw += np.pi / 2
    pose = pose_of(local + offset, np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]))
    return pose if placement.support is None else poses[placement.support] @ pose


def _support_point(
    placement: PlacementConfig, things: dict[str, ObjectModel], fixed: dict[str, FurnitureModel]
) -> np.ndarray:
    """Middle of the surface that carries a thing, in the frame of what carries it in [m], shape (3,)."""
    if placement.stands_on is not None:
        carrier = things.get(placement.stands_on) or fixed[placement.stands_on]
        return np.array([0.0, 0.0, carrier.extents[2] / 2])
    if placement.lies_in in things:
        container = things[placement.lies_in]
        return np.array([0.0, 0.0, container.inner_floor - container.extents[2] / 2])
    if placement.lies_in is not None:
        inside = fixed[placement.lies_in].compartments[0]
        return np.append((inside.low + inside.high)[:2] / 2, inside.low[2])
    if placement.lies_behind_handles_of is not None:
        return slot_behind_handles(fixed[placement.lies_behind_handles_of])
    return np.zeros(3)


def slot_behind_handles(thing: FurnitureModel) -> np.ndarray:
    """Middle of the slot between closed doors and their handles, on the lower stand-offs, in the furniture's frame."""
    doors = _hinged(thing)
    places = []
    for door in doors:
        panel = door.boards[0].solid
        front = panel.position[0] - panel.half[0]
        back = door.handle.centre[0] + door.handle.half_depth
        places.append(door.anchor + np.array([(front + back) / 2, door.handle.centre[1], 0.0]))
    return np.append(np.mean(places, axis=0)[:2], max(stand_off_top(d) for d in doors))


@dataclass(frozen=True)
class _Outline:
    """Footprint on the table: a circle, or a rectangle with rounded corners of radius zero.

    Attributes:
        centre: In [m], shape (2,).
        axes: Unit vectors of the rectangle, one a column, shape (2, 2).
        half: Half sizes in [m], shape (2,); zero for a circle.
        radius: Of the circle in [m], else 0.
    """

    centre: NDArray[np.float64]
    axes: NDArray[np.float64]
    half: NDArray[np.float64]
    radius: float


def _outline(
    name: str, things: dict[str, ObjectModel], fixed: dict[str, FurnitureModel], poses: dict[str, np.ndarray]
) -> _Outline:
    pose = poses[name]
    if name in things:
        return _Outline(pose[:2, 3], np.eye(2), np.zeros(2), things[name].footprint_radius)
    return _Outline(pose[:2, 3], pose[:2, :2], fixed[name].extents[:2] / 2, 0.0)


def _distance(a: _Outline, b: _Outline) -> float:
    """Least distance of two outlines in [m]; zero or less where they overlap.

    Of two rectangles it is the largest gap along their sides' directions, which is at most the distance.
    """
    between = b.centre - a.centre
    if not a.half.any() and not b.half.any():
        return float(np.linalg.norm(between)) - a.radius - b.radius
    if not a.half.any() or not b.half.any():
        rectangle, circle, sign = (a, b, 1.0) if a.half.any() else (b, a, -1.0)
        outside = np.maximum(np.abs(rectangle.axes.T @ (sign * between)) - rectangle.half, 0.0)
        return float(np.linalg.norm(outside)) - circle.radius
    gaps = []
    for axis in (*a.axes.T, *b.axes.T):
        reach = np.abs(a.axes.T @ axis) @ a.half + np.abs(b.axes.T @ axis) @ b.half
        gaps.append(abs(float(axis @ between)) - float(reach))
    return max(gaps)
