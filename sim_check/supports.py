"""Setting perceived things down on whatever is under them.

A camera sees tops; where a thing ends below is inferred, and may be off by centimetres when something hides it. So
tops are trusted and bottoms follow from supports.
"""

from dataclasses import dataclass, replace

import numpy as np

from control.errors import StackError
from sim_check.object_library import ObjectModel, object_model

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


def set_down(things: list[Standing], table: float) -> list[Standing]:
    """Put every thing on the highest support under its centre: the table, another thing, or a container's floor.

    Lower tops first, so that what carries others is in place before them.

    Args:
        things: As perceived.
        table: Height of the table top in [m].

    Returns:
        The same things, in the order of their tops.

    Raises:
        StackError: A thing floats more than `FLOATING` above anything that could carry it.
    """
    placed: list[Standing] = []
    for s in sorted((replace(s, pose=upright(s.pose)) for s in things), key=lambda s: (_container_first(s), s.top)):
        placed.append(_on(s, max([table] + [_support_height(s, other) for other in placed])))
    return placed


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
