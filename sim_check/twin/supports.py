"""Setting perceived things down on whatever is under them.

A camera sees tops; where a thing ends below is inferred, and may be off by centimetres when something hides it. So
tops are trusted and bottoms follow from supports.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from control.errors import StackError
from control.twin_model import TwinModel
from sim_check.furniture.model import FurnitureModel
from sim_check.objects.library import object_model
from sim_check.twin.ledges import carried_at, furniture_ledges
from sim_check.twin.placed import Fixed, Standing
from sim_check.twin.snapping import snap

# Gap or overlap with its support, in [m], that is taken for an error of the inferred bottom: the box is made taller or
# shorter and its top stays. A larger gap means that the whole thing was perceived too high: it is lowered.
BOTTOM_ERROR = 0.012
# A thing that seems to float this far above any support, in [m], is in the hand or on something that was not perceived.
FLOATING = 0.10
# A thing cannot be lower than this share of its perceived height once its bottom is corrected.
LEAST_HEIGHT = 0.35
LEAST_ON_SHELF = 0.012  # height in [m] of what lies on a shelf or on top of furniture
_AIR = 2e-4  # left under things for the contact to close, in [m]


def set_down(
    things: list[Standing], table: float, furniture: Sequence[Fixed] = (), others: Sequence[Standing] = ()
) -> list[Standing]:
    """Put every thing on the highest support under its centre.

    Supports are the table, another thing, a container's floor, the shelf inside furniture or its top, and the
    stand-offs of its handles. Lower tops first, so that what carries others is in place before them.

    Args:
        things: As perceived.
        table: Height of the table top in [m].
        furniture: Where furniture stands.
        others: What stays where it is and may carry them.

    Returns:
        The same things, in the order of their tops.

    Raises:
        StackError: A thing floats more than `FLOATING` above anything that could carry it.
    """
    placed: list[Standing] = []
    ledges = [ledge for f in furniture for ledge in furniture_ledges(f)]
    for s in sorted((replace(s, pose=upright(s.pose)) for s in things), key=lambda s: (_container_first(s), s.top)):
        under = max([table] + [_support_height(s, other) for other in (*others, *placed)])
        shelf, hung = carried_at(s, ledges)
        rested = None
        if hung > max(under, shelf) or (ledges and s.bottom - max(under, shelf) > FLOATING):
            rested = snap(s.thing, s.pose, furniture, [ledge.top for ledge in ledges])
        placed.append(rested or _on(s, max(under, shelf, hung), inside=shelf >= max(under, hung)))
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


def _on(s: Standing, support: float, inside: bool = False) -> Standing:
    """The thing with its bottom at a height in [m].

    Perception takes a box down to the table; of one on a shelf (`inside`) little may be left above it.
    """
    gap = s.bottom - support
    if gap > FLOATING:
        raise StackError(
            f"'{s.thing.name}' was perceived {gap * 1e3:.0f} mm above anything that could carry it; "
            "say that it is held if the hand has it, else look again"
        )
    height = s.top - support
    least = LEAST_ON_SHELF if inside else LEAST_HEIGHT * s.thing.extents[2]
    stretch = gap < BOTTOM_ERROR and height >= least
    if stretch and not s.thing.rolls and not s.thing.container:
        extents = np.array([s.thing.extents[0], s.thing.extents[1], height])
        s = replace(s, thing=object_model(s.thing.name, extents, s.thing.shape))
    pose = s.pose.copy()
    pose[2, 3] = support + s.thing.extents[2] / 2 + _AIR
    return replace(s, pose=pose)
