"""Setting perceived things down on whatever is under them.

A camera sees tops; where a thing ends below is inferred, and may be off by centimetres when something hides it. So
tops are trusted and bottoms follow from supports.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from control.errors import StackError
from control.twin_model import TwinModel
from sim_check.furniture_model import FurnitureModel
from sim_check.object_library import ObjectModel, Solid, object_model

# Gap or overlap with its support, in [m], that is taken for an error of the inferred bottom: the box is made taller or
# shorter and its top stays. A larger gap means that the whole thing was perceived too high: it is lowered.
BOTTOM_ERROR = 0.012
# A thing that seems to float this far above any support, in [m], is in the hand or on something that was not perceived.
FLOATING = 0.10
# A thing cannot be lower than this share of its perceived height once its bottom is corrected.
LEAST_HEIGHT = 0.35
_AIR = 2e-4  # left under things for the contact to close, in [m]


@dataclass(frozen=True)
class Standing:
    """A thing and where it is.

    Attributes:
        thing: What it is.
        pose: Its frame in the world, shape (4, 4).
    """

    thing: ObjectModel
    pose: np.ndarray

    @property
    def top(self) -> float:
        """Height of its highest point in the world in [m], its z being up."""
        return float(self.pose[2, 3] + self.thing.extents[2] / 2)

    @property
    def bottom(self) -> float:
        """Height of its lowest point in the world in [m], its z being up."""
        return float(self.pose[2, 3] - self.thing.extents[2] / 2)


@dataclass(frozen=True)
class Fixed:
    """Furniture and where it is.

    Attributes:
        thing: What it is.
        pose: Its frame in the world, shape (4, 4); z is up.
        fractions: How far its joints are open, 0 closed .. 1 open, by name.
    """

    thing: FurnitureModel
    pose: np.ndarray
    fractions: dict[str, float]


def set_down(things: list[Standing], table: float, furniture: Sequence[Fixed] = ()) -> list[Standing]:
    """Put every thing on the highest support under its centre: the table, another thing, a container's floor, the
    shelf inside furniture or its top, the stand-offs of its handles.

    Lower tops first, so that what carries others is in place before them.

    Args:
        things: As perceived.
        table: Height of the table top in [m].
        furniture: Where furniture stands.

    Returns:
        The same things, in the order of their tops.

    Raises:
        StackError: A thing floats more than `FLOATING` above anything that could carry it.
    """
    placed: list[Standing] = []
    for s in sorted((replace(s, pose=upright(s.pose)) for s in things), key=lambda s: (_container_first(s), s.top)):
        under = [table] + [_support_height(s, other) for other in placed]
        placed.append(_on(s, max(under + [_ledge_height(s, f) for f in furniture])))
    return placed


def stand(thing: FurnitureModel, pose: np.ndarray, table: float) -> np.ndarray:
    """Pose of furniture upright on the table, shape (4, 4), from its pose as perceived.

    Raises:
        StackError: It was perceived leaning by more than 30 degrees.
    """
    out = upright(pose)
    if out[2, 2] < np.cos(np.deg2rad(1.0)):
        raise StackError(f"'{thing.name}' was perceived lying; furniture stands: look again")
    out[2, 3] = table + thing.extents[2] / 2
    return out


def carrier(twin: TwinModel, fixed: set[str]) -> dict[str, str]:
    """Which furniture carries which free things, directly or through other things, at the start of a twin.

    Args:
        twin: At rest.
        fixed: Names of the furniture.

    Returns:
        Name of the furniture by name of the thing that touches it or its parts from above or from within; things on
        the table that merely touch it are not carried.
    """
    model, data = twin.model, twin.start()
    free = {o.name for o in twin.objects if o.movable}

    def root(body: int) -> str:
        while model.body_parentid[body] != 0:
            body = int(model.body_parentid[body])
        return model.body(body).name

    under: dict[str, set[str]] = {}
    for contact in data.contact[: data.ncon]:
        a, b = (root(int(model.geom_bodyid[g])) for g in contact.geom)
        # The normal points from the first geom to the second: what lies above is carried.
        for low, high, up in ((a, b, contact.frame[2]), (b, a, -contact.frame[2])):
            if high in free and up > 0.5:
                under.setdefault(high, set()).add(low)
    out: dict[str, str] = {}
    for _ in range(len(free)):
        for name, carriers in under.items():
            found = sorted((carriers & fixed) | {out[c] for c in carriers if c in out})
            if found and name not in out:
                out[name] = found[0]
    return out


def upright(pose: np.ndarray) -> np.ndarray:
    """The pose turned by the smallest rotation that makes its z axis point up, shape (4, 4).

    Perception aligns boxes with gravity, so this only takes out rounding; a thing whose z points sideways is kept.
    """
    tilt = np.arccos(np.clip(pose[2, 2], -1.0, 1.0))
    axis = np.cross(pose[:3, 2], [0.0, 0.0, 1.0])
    length = np.linalg.norm(axis)
    if length < 1e-9 or tilt > np.deg2rad(30.0):
        return pose.copy()
    x, y, z = axis / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = np.eye(3) + np.sin(tilt) * cross + (1 - np.cos(tilt)) * cross @ cross
    out = pose.copy()
    out[:3, :3] = turn @ pose[:3, :3]
    return out


def _container_first(s: Standing) -> int:
    return 0 if s.thing.container else 1


def _support_height(s: Standing, other: Standing) -> float:
    """Height at which `other` carries `s` in [m]; minus infinity if it does not."""
    local = other.pose[:3, :3].T @ (s.pose[:3, 3] - other.pose[:3, 3])
    if other.thing.container:
        inside = float(np.hypot(*local[:2])) < other.thing.inner_radius
        return other.bottom + other.thing.inner_floor if inside else -np.inf
    half = other.thing.extents / 2
    if other.thing.rolls or np.any(np.abs(local[:2]) > half[:2]):
        return -np.inf
    # What ends below the other's top is beside it or inside it, not on it.
    return other.top if s.top > other.top + LEAST_HEIGHT * min(s.thing.extents[2], 0.03) else -np.inf


def _ledge_height(s: Standing, furniture: Fixed) -> float:
    """Height at which furniture carries a thing in [m]; minus infinity if it does not.

    Every solid of it that lies under the thing's footprint carries it if it ends no higher than the thing's bottom,
    errors of the bottom allowed; of a shelf and a top, the top ends higher than what stands inside.
    """
    best = -np.inf
    slack = min(max(BOTTOM_ERROR, 0.4 * s.thing.extents[2]), 0.03)
    for solid, pose in _world_solids(furniture):
        top = float(pose[2, 3] + _half_height(solid, pose))
        if top <= s.bottom + slack and top > best and _above(s, solid, pose):
            best = top
    return best


def _world_solids(furniture: Fixed) -> list[tuple[Solid, np.ndarray]]:
    """Solids of furniture, its parts opened, with their poses in the world."""
    frames = [(furniture.pose, furniture.thing.boards)]
    for part in furniture.thing.parts:
        value = furniture.fractions.get(part.name, 0.0) * part.opened
        move = np.eye(4)
        if part.kind == "hinge":
            quat, rotation = np.zeros(4), np.zeros(9)
            mujoco.mju_axisAngle2Quat(quat, part.axis, value)
            mujoco.mju_quat2Mat(rotation, quat)
            move[:3, :3] = rotation.reshape(3, 3)
            move[:3, 3] = part.anchor
        else:
            move[:3, 3] = part.anchor + value * part.axis
        frames.append((furniture.pose @ move, part.boards))
    out = []
    for frame, boards in frames:
        for board in boards:
            if board.solid_to_touch:
                local, rotation = np.eye(4), np.zeros(9)
                mujoco.mju_quat2Mat(rotation, np.asarray(board.solid.quat, float))
                local[:3, :3], local[:3, 3] = rotation.reshape(3, 3), board.solid.position
                out.append((board.solid, frame @ local))
    return out


def _half_sizes(solid: Solid) -> np.ndarray:
    half = np.array(solid.half, float)
    if solid.kind == "capsule":
        half[2] += half[0]
    return half


def _half_height(solid: Solid, pose: np.ndarray) -> float:
    half = np.array(solid.half, float)
    if solid.kind == "capsule":
        return float(abs(pose[2, 2]) * half[2] + half[0])
    return float(np.abs(pose[2, :3]) @ half)


def _above(s: Standing, solid: Solid, pose: np.ndarray) -> bool:
    """Whether a thing's footprint and a solid's, as rectangles on the ground, overlap: separating axes."""
    ours = (s.pose[:2, 3], s.pose[:2, :3] * (s.thing.extents / 2))
    theirs = (pose[:2, 3], pose[:2, :3] * _half_sizes(solid))
    between = theirs[0] - ours[0]
    for axis in (*s.pose[:2, :2].T, *pose[:2, :3].T):
        length = np.linalg.norm(axis)
        if length < 1e-6:
            continue
        axis = axis / length
        reach = np.abs(axis @ ours[1]).sum() + np.abs(axis @ theirs[1]).sum()
        if abs(float(axis @ between)) > reach:
            return False
    return True


def _on(s: Standing, support: float) -> Standing:
    """The thing with its bottom at a height in [m]."""
    gap = s.bottom - support
    if gap > FLOATING:
        raise StackError(
            f"'{s.thing.name}' was perceived {gap * 1e3:.0f} mm above anything that could carry it; "
            "say that it is held if the hand has it, else look again"
        )
    height = s.top - support
    stretch = gap < BOTTOM_ERROR and height >= LEAST_HEIGHT * s.thing.extents[2]
    if stretch and not s.thing.rolls and not s.thing.container:
        extents = np.array([s.thing.extents[0], s.thing.extents[1], height])
        s = replace(s, thing=object_model(s.thing.name, extents, _solid(s.thing)))
    pose = s.pose.copy()
    pose[2, 3] = support + s.thing.extents[2] / 2 + _AIR
    return replace(s, pose=pose)


def _solid(thing: ObjectModel):
    kind = thing.solids[0].kind
    return kind if kind in ("box", "cylinder") else "sphere"
