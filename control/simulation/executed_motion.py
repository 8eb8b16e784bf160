"""A motion as it was executed step by step in the twin, and the joint path that plays it again.

Sampling planners move arm and fingers at the same time. A path acts with its gripper only between segments, at rest,
so the motion is cut there: where closing fingers came to a stop (that is where they took hold), and where they were
told to open. A carried object may touch others in those stretches in which it did while the motion was executed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.simulation.motion_recording import contact_names
from control.trajectory.samples import GripperCommand, JointPath, PathSegment
from control.twin_model import FINGER_BODIES, TwinModel

WAYPOINT_TIME = 0.02  # [s] between waypoints of the path
STOPPED = 0.01  # [m/s] of the width between the pads: fingers close at ten times this speed
BEGUN = 0.06  # [s] after which closing fingers have surely set out
LOOKS = 3  # after a grasp, within which both fingers must be seen to touch what they hold
HELD_WIDTH = 0.004  # [m]: narrower, the fingers hold nothing


@dataclass(frozen=True)
class Contact:
    """What was touched in one state.

    Attributes:
        held: The object that both fingers touch, or None.
        by_held: Names of what it touches beside the fingers.
    """

    held: str | None
    by_held: tuple[str, ...]


@dataclass(frozen=True)
class MotionPiece:
    """Some steps of a motion between two looks at the state.

    Attributes:
        arm: Commanded joint positions in [rad] after each step, shape (n, 7).
        closed: Whether the fingers were told to be closed, shape (n,).
        width: Distance between the pads in [m] after each step, shape (n,).
        contact: What was touched at the end.
    """

    arm: NDArray[np.float64]
    closed: NDArray[np.bool_]
    width: NDArray[np.float64]
    contact: Contact


def contact_at(twin: TwinModel, data: mujoco.MjData, names: Sequence[str]) -> Contact:
    """What fingers and a held object touch.

    Args:
        twin: For the objects' names.
        data: A state whose contacts are up to date.
        names: `geom_names` of the twin.
    """
    pairs = {
        frozenset((names[int(a)], names[int(b)])) for a, b in data.contact.geom[: data.ncon] if names[a] != names[b]
    }
    objects = [o.name for o in twin.objects if o.movable]
    held = next((n for n in objects if all(frozenset((n, finger)) in pairs for finger in FINGER_BODIES)), None)
    touched = sorted(name for pair in pairs if held in pair for name in pair if name not in (held, *FINGER_BODIES))
    return Contact(held, tuple(touched))


def geom_names(twin: TwinModel) -> list[str]:
    """Name of the link, object or door that each geom belongs to."""
    return contact_names(twin.model, frozenset(o.name for o in twin.objects) | {j.body for j in twin.joints})


def joint_path(twin: TwinModel, pieces: Sequence[MotionPiece], opening: float) -> JointPath:
    """The path of an executed motion.

    Args:
        twin: For the start.
        pieces: The motion in order.
        opening: Distance between the pads of open fingers in [m].
    """
    dt = float(twin.model.opt.timestep)
    arm = np.vstack([twin.q, *[p.arm for p in pieces]])
    closed = np.concatenate([[_shut(twin)], *[p.closed for p in pieces]])
    width = np.concatenate([[twin.gripper_width], *[p.width for p in pieces]])
    ends = np.cumsum([len(p.arm) for p in pieces])  # rows at which the contacts are known
    events = _gripper_events(closed, width, opening, dt)
    stride = max(1, round(WAYPOINT_TIME / dt))
    segments: list[PathSegment] = []
    first, held = 0, twin.held
    cuts = {*events, *_contact_changes(pieces), len(arm) - 1}
    for cut in sorted(cuts):
        rows = np.unique([*range(first, cut, stride), cut])
        known = int(np.searchsorted(ends, cut, "right")) - 1  # the last look before or at the cut
        contact = pieces[known].contact if known >= 0 else Contact(None, ())
        touching = tuple((held, name) for name in contact.by_held) if held is not None else ()
        command = events.get(cut)
        segments.append(PathSegment("carry" if held else "move", arm[rows], command, held, touching))
        if command is not None:
            held = None
            if command.kind == "grasp":
                soon = [p.contact.held for p in pieces[known + 1 : known + 1 + LOOKS]]
                held = next((name for name in soon if name is not None), None)
        first = cut
    return JointPath(tuple(_joined(segments)))


def _shut(twin: TwinModel) -> bool:
    return twin.held is not None or twin.gripper_width < HELD_WIDTH


def _gripper_events(closed: np.ndarray, width: np.ndarray, opening: float, dt: float) -> dict[int, GripperCommand]:
    """Commands by the row after which they are given: a grasp where closing fingers stopped, an opening when told."""
    out: dict[int, GripperCommand] = {}
    changes = np.flatnonzero(np.diff(closed.astype(int))) + 1
    look = max(1, round(WAYPOINT_TIME / dt))
    for change, until in pairwise([*changes, len(closed)]):
        if not closed[change]:
            out[int(change) - 1] = GripperCommand("move", opening)
            continue
        row = min(change + round(BEGUN / dt), until - 1)
        while row + look < until and width[row] - width[row + look] > STOPPED * look * dt:
            row += 1
        kept = min(float(width[row]), opening)
        out[int(row)] = GripperCommand("grasp", kept) if kept > HELD_WIDTH else GripperCommand("move", 0.0)
    return out


def _contact_changes(pieces: Sequence[MotionPiece]) -> list[int]:
    """Rows at which a carried object began or ceased to touch other things."""
    rows, end = [], 0
    for piece, following in pairwise(pieces):
        end += len(piece.arm)
        now, then = piece.contact, following.contact
        if now.held is not None and then.held == now.held and bool(now.by_held) != bool(then.by_held):
            rows.append(end)
    return rows


def _joined(segments: list[PathSegment]) -> list[PathSegment]:
    """Stretches that nothing tells apart as one: a carried object's contacts come and go with every look."""
    out: list[PathSegment] = []
    for segment in segments:
        before = out[-1] if out else None
        same = before is not None and before.gripper is None and before.held == segment.held
        if before is not None and same and bool(before.touching) == bool(segment.touching):
            touching = tuple(sorted({*before.touching, *segment.touching}))
            q = np.vstack([before.q, segment.q[1:]])
            out[-1] = PathSegment(before.name, q, segment.gripper, segment.held, touching)
        else:
            out.append(segment)
    return out
