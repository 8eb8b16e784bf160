"""What truly was in a recorded picture or stands in a simulated cell: for scorers only, never an input of perception.

Needs numpy only.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from perception.estimates import Shape


@dataclass(frozen=True)
class TrueObject:
    """One thing that truly was there.

    Attributes:
        name: Lower case with underscores; the phrase that asks for it is the name with spaces.
        world_T_object: Pose of its box centre in the frame's world, shape (4, 4).
        extents: Full sizes along its own axes in [m], shape (3,); None where the recording does not say.
        shape: Box, cylinder or sphere; None where the recording does not say. A sphere or cylinder has no yaw.
        mask: Its visible pixels, bool, shape (height, width); None where the recording does not say.
        box_px: Around its visible pixels, (x0, y0, x1, y1) in [px], shape (4,), x1 and y1 just outside; or None.
        visible_share: Visible pixels over the pixels it would have with nothing in front, 0..1; 1 where unknown.
        joint_fractions: How far each of its joints is open, 0 closed .. 1 open.
    """

    name: str
    world_T_object: NDArray[np.float64]
    extents: NDArray[np.float64] | None = None
    shape: Shape | None = None
    mask: NDArray[np.bool_] | None = None
    box_px: NDArray[np.float64] | None = None
    visible_share: float = 1.0
    joint_fractions: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True)
class FrameTruth:
    """Everything that truly was in one frame, and which names certainly were not.

    Attributes:
        objects: All that can be asked for and shows at least a few pixels.
        absent: Names that a fair question may ask for in vain.
    """

    objects: tuple[TrueObject, ...]
    absent: tuple[str, ...] = ()


@dataclass(frozen=True)
class StandingThing:
    """One thing of a simulated cell, seen or not.

    Attributes:
        name: Scene name.
        world_T_object: Pose of its box centre in the world, shape (4, 4).
        extents: Full sizes along its own axes in [m], shape (3,).
        velocity: Linear velocity in [m/s], then angular in [rad/s], along the world's axes, shape (6,).
        fixed: Whether it is furniture, which nothing moves.
    """

    name: str
    world_T_object: NDArray[np.float64]
    extents: NDArray[np.float64]
    velocity: NDArray[np.float64]
    fixed: bool


@dataclass(frozen=True)
class TrueJoint:
    """One joint of furniture.

    Attributes:
        name: Of the joint.
        position: In [rad] or [m], 0 closed.
        fraction: The same as a share, 0 closed .. 1 open.
    """

    name: str
    position: float
    fraction: float


@dataclass(frozen=True)
class CellTruth:
    """Everything that stands in a simulated cell at one time.

    Attributes:
        things: Loose ones and furniture, by name.
        joints: Of the furniture, by name.
    """

    things: Mapping[str, StandingThing]
    joints: Mapping[str, TrueJoint]

    @property
    def poses(self) -> dict[str, np.ndarray]:
        """`world_T_object` of loose things, shape (4, 4) each, by name."""
        return {name: thing.world_T_object for name, thing in self.things.items() if not thing.fixed}


def box_around(mask: np.ndarray) -> np.ndarray:
    """(x0, y0, x1, y1) around the pixels of a mask that has some, in [px], x1 and y1 just outside; shape (4,)."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], float)
