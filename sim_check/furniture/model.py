"""What furniture is made of, ready to be built: boards that stand fixed, parts that turn or slide, insides.

A furniture's frame lies at the centre of its box (from the table to its top, handles and opened doors left out) with x
from the front to the back, y to the left hand's side and z up. Seen from a robot at the origin, furniture with the
world's orientation faces it. Lengths in [m].
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from control.twin_model import Handle, TwinCompartment, TwinJoint
from sim_check.objects.solids import SolidShape

Look = Literal["shell", "front", "metal", "glass", "dark", "accent", "hidden"]


@dataclass(frozen=True)
class Board:
    """One solid of furniture.

    Attributes:
        solid: In the frame of the body that it belongs to.
        look: Which surface it shows; what is "hidden" is never seen by a camera.
        solid_to_touch: Whether things bump into it; otherwise it is a picture only.
    """

    solid: SolidShape
    look: Look
    solid_to_touch: bool = True


@dataclass(frozen=True)
class MovingPart:
    """A part on a joint, closed at joint position 0.

    Attributes:
        name: Of part and joint.
        kind: Whether it turns ([rad]) or slides ([m]).
        anchor: Origin of its frame in the furniture's frame at fraction 0, shape (3,); its axes are parallel then. The
            joint's axis goes through it.
        axis: Unit vector of the joint, shape (3,).
        opened: Joint position at fraction 1 and the upper end of its range.
        boards: In its own frame.
        mass: In [kg].
        friction: Dry friction in [Nm] or [N].
        damping: In [Nm s/rad] or [N s/m].
        stiffness: Of a spring that holds it at 0 in [N/m]; only for sprung plates.
        preload: Force in [N] with which the spring presses it against its end at 0.
        handle: In its own frame; None for what is not driven by hand.
    """

    name: str
    kind: Literal["hinge", "slide"]
    anchor: NDArray[np.float64]
    axis: NDArray[np.float64]
    opened: float
    boards: tuple[Board, ...]
    mass: float
    friction: float
    damping: float
    stiffness: float = 0.0
    preload: float = 0.0
    handle: Handle | None = None


@dataclass(frozen=True)
class FurnitureModel:
    """One piece of furniture.

    Attributes:
        name: Scene name, also the name of its fixed body.
        kind: Kind in the cell file.
        extents: Full sizes of its box in [m], shape (3,).
        boards: Fixed ones, in the furniture's frame.
        parts: What moves.
        compartments: Insides.
        rgb: Colour, 0..1.
        wooden: Whether its boards show grain.
    """

    name: str
    kind: str
    extents: NDArray[np.float64]
    boards: tuple[Board, ...]
    parts: tuple[MovingPart, ...]
    compartments: tuple[TwinCompartment, ...]
    rgb: tuple[float, float, float]
    wooden: bool

    @property
    def joints(self) -> tuple[TwinJoint, ...]:
        """Joints that a hand can drive."""
        return tuple(
            TwinJoint(p.name, p.name, self.name, p.kind, 0.0, p.opened, p.axis, np.zeros(3), p.handle)
            for p in self.parts
            if p.handle is not None
        )

    def part(self, name: str) -> MovingPart | None:
        """The moving part of this name, or None."""
        return next((p for p in self.parts if p.name == name), None)


def box(low, high, look: Look) -> Board:
    """A board by its corners in [m]."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    return Board(SolidShape("box", (high - low) / 2, (high + low) / 2), look)


def rod(start, end, radius: float, look: Look) -> Board:
    """A capsule between two points in [m] that differ along one axis only; `radius` reaches beyond them."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    along = int(np.argmax(np.abs(end - start)))
    half = np.abs(end - start)[along] / 2
    # From z to the axis: about y for x, about x for y.
    turned = np.sqrt(0.5)
    quat = {0: [turned, 0.0, turned, 0.0], 1: [turned, turned, 0.0, 0.0], 2: [1.0, 0.0, 0.0, 0.0]}[along]
    return Board(SolidShape("capsule", np.array([radius, radius, half]), (start + end) / 2, np.array(quat)), look)
