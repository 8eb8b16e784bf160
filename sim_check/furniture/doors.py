"""Cabinets and microwaves: a shell, doors in front of it, bar handles on stand-offs."""

from dataclasses import dataclass

import numpy as np

from control.twin_model import Handle, TwinCompartment
from perception.catalogue.catalogue import builtin_catalogue
from sim_check.cells.furniture_config import BOARD, CabinetConfig, MicrowaveConfig
from sim_check.furniture.model import Board, FurnitureModel, MovingPart, box, rod
from sim_check.objects.solids import SolidShape

DOOR_THICKNESS = 0.018
DOOR_GAP = 0.003  # between the shell's front and a door's back, and around its edges
FINGER_ROOM = 0.01  # of a bar's ends that stand-offs take from fingers


@dataclass(frozen=True)
class _Panel:
    """A door's panel, in the furniture's frame.

    Attributes:
        name: Of the door.
        low, high: Its ends in y in [m].
        free_edge: +1 or -1: the side of y where its handle is.
    """

    name: str
    low: float
    high: float
    free_edge: int


def build_cabinet(name: str, config: CabinetConfig | MicrowaveConfig) -> FurnitureModel:
    """Shell, doors and inside of a cabinet or microwave."""
    extents = np.array([config.depth, config.width, config.bottom + config.height])
    boards = _shell(config, extents)
    left = 1 if config.hinge == "left" else -1
    half = config.width / 2
    names = config.part_names(name)
    compartment_low, compartment_high = -half + BOARD, half - BOARD
    if isinstance(config, CabinetConfig) and config.opening == "sliding":
        # The door covers one half and slides towards the hinge's side, in front of the other half.
        boards += _closed_half(config, extents, left)
        edges = sorted((-left * half, left * BOARD))
        panels = [_Panel(names[0], *edges, free_edge=left)]
        parts = tuple(_sliding_door(p, config, extents, left) for p in panels)
        if left > 0:
            compartment_high = -BOARD / 2
        else:
            compartment_low = BOARD / 2
    else:
        if len(names) == 2:
            panels = [
                _Panel(names[0], 0.0, half, free_edge=-1),
                _Panel(names[1], -half, 0.0, free_edge=1),
            ]
        else:
            panels = [_Panel(names[0], -half, half, free_edge=-left)]
        parts = tuple(_hinged_door(p, config, extents) for p in panels)
    floor = config.bottom + BOARD - extents[2] / 2
    ceiling = extents[2] / 2 - BOARD
    inside = TwinCompartment(
        owner=name,
        low=np.array([-config.depth / 2, compartment_low, floor]),
        high=np.array([config.depth / 2 - BOARD, compartment_high, ceiling]),
        outward=np.array([-1.0, 0.0, 0.0]),
        joints=tuple(p.name for p in parts),
    )
    rgb = builtin_catalogue().paints[config.colour]
    return FurnitureModel(name, config.kind, extents, boards, parts, (inside,), rgb, config.colour == "wood")


def _shell(config: CabinetConfig | MicrowaveConfig, extents: np.ndarray) -> tuple[Board, ...]:
    x, y, z = extents / 2
    low = config.bottom - z
    boards = [
        box((-x, -y, low), (x, y, low + BOARD), "shell"),
        box((-x, -y, z - BOARD), (x, y, z), "shell"),
        box((-x, -y, low + BOARD), (x, -y + BOARD, z - BOARD), "shell"),
        box((-x, y - BOARD, low + BOARD), (x, y, z - BOARD), "shell"),
        box((x - BOARD, -y + BOARD, low + BOARD), (x, y - BOARD, z - BOARD), "shell"),
    ]
    if config.bottom > 0:
        # The stand is set back a little, as kitchen plinths are.
        boards.append(box((-x + 0.02, -y + 0.01, -z), (x, y - 0.01, low), "dark"))
    return tuple(boards)


def _closed_half(config: CabinetConfig, extents: np.ndarray, side: int) -> tuple[Board, ...]:
    """The fixed front on the side to which the door slides, and the wall behind its edge."""
    x, y, z = extents / 2
    low = config.bottom - z + BOARD
    edges = sorted((0.0, side * (y - BOARD)))
    return (
        box((-x, edges[0], low), (-x + BOARD / 2, edges[1], z - BOARD), "front"),
        box((-x, -BOARD / 2, low), (x - BOARD, BOARD / 2, z - BOARD), "shell"),
    )


def _hinged_door(panel: _Panel, config: CabinetConfig | MicrowaveConfig, extents: np.ndarray) -> MovingPart:
    """A door on the edge away from its handle; it opens outwards as its joint position grows."""
    hinge = panel.low if panel.free_edge > 0 else panel.high
    anchor = np.array([_door_plane(extents), hinge, 0.0])
    boards, handle = _door_boards(panel, config, extents, anchor)
    # About -z the direction +y (from a hinge on the right) turns towards +x; outwards is -x.
    axis = np.array([0.0, 0.0, float(panel.free_edge)])
    return MovingPart(
        name=panel.name,
        kind="hinge",
        anchor=anchor,
        axis=axis,
        opened=config.door_range,
        boards=boards,
        mass=config.door_mass,
        friction=config.door_friction,
        damping=config.door_damping,
        handle=handle,
    )


def _sliding_door(panel: _Panel, config: CabinetConfig, extents: np.ndarray, side: int) -> MovingPart:
    anchor = np.array([_door_plane(extents), (panel.low + panel.high) / 2, 0.0])
    # Its handle is on the edge from which it slides away, so that the opened door's handle stays within reach.
    boards, handle = _door_boards(_Panel(panel.name, panel.low, panel.high, -side), config, extents, anchor)
    return MovingPart(
        name=panel.name,
        kind="slide",
        anchor=anchor,
        axis=np.array([0.0, float(side), 0.0]),
        opened=config.width / 2 - 2 * BOARD,
        boards=boards,
        mass=config.door_mass,
        friction=config.door_friction,
        damping=config.door_damping,
        handle=handle,
    )


def _door_plane(extents: np.ndarray) -> float:
    """X of the doors' middle."""
    return float(-extents[0] / 2 - DOOR_GAP - DOOR_THICKNESS / 2)


def _door_boards(
    panel: _Panel, config: CabinetConfig | MicrowaveConfig, extents: np.ndarray, anchor: np.ndarray
) -> tuple[tuple[Board, ...], Handle]:
    """Panel, bar and stand-offs in the door's frame, and the bar as a handle."""
    z = extents[2] / 2
    front = -DOOR_THICKNESS / 2
    low = np.array([front, panel.low + DOOR_GAP / 2 - anchor[1], config.bottom - z + DOOR_GAP])
    high = np.array([-front, panel.high - DOOR_GAP / 2 - anchor[1], z - DOOR_GAP])
    edge = (panel.high if panel.free_edge > 0 else panel.low) - anchor[1]
    centre = np.array(
        [front - config.handle_standoff, edge - panel.free_edge * config.handle_inset, config.handle_height - z]
    )
    half, radius = config.handle_length / 2, config.handle_radius
    along = np.array([0.0, 0.0, half])
    boards = [
        box(low, high, "front"),
        rod(centre - along, centre + along, radius, "metal"),
    ]
    for start in (centre - along, centre + along):
        boards.append(rod(start, [front, start[1], start[2]], 0.75 * radius, "metal"))
    if isinstance(config, MicrowaveConfig):
        boards.append(_window(low, high))
    handle = Handle(
        body=panel.name,
        shape="capsule",
        centre=centre,
        axis=np.array([0.0, 0.0, 1.0]),
        outward=np.array([-1.0, 0.0, 0.0]),
        half_length=half - FINGER_ROOM - 0.75 * radius,
        half_width=radius,
        half_depth=radius,
        clearance=config.handle_standoff - radius,
    )
    return tuple(boards), handle


def _window(low: np.ndarray, high: np.ndarray) -> Board:
    """A dark pane in a microwave's door: one cannot look through it."""
    rim = np.array([0.0, 0.05, 0.05])
    pane = box(np.array([low[0] - 5e-4, *(low + rim)[1:]]), np.array([low[0] + 5e-4, *(high - rim)[1:]]), "glass")
    return Board(pane.solid, "glass", solid_to_touch=False)


def stand_off_top(part: MovingPart) -> float:
    """Height of the upper side of a door's lower stand-off in the furniture's frame in [m]: bars lie on it."""
    posts = [b.solid for b in part.boards if b.look == "metal"][1:]
    lowest: SolidShape = min(posts, key=lambda s: s.position[2])
    return float(part.anchor[2] + lowest.position[2] + lowest.half[0])
