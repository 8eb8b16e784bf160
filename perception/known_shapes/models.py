"""Things whose shape is known beforehand: boards that stand fixed and parts that turn or slide on joints.

A model's frame lies at the centre of its box (from the support to its top) with z up, as the estimate's frame does.
A part's frame lies on its joint's axis and is parallel to the model's at fraction 0. Lengths in [m].
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from perception.geometry.solids import Solid


@dataclass(frozen=True)
class KnownBox:
    """One board or round bar along the axes of its frame.

    Attributes:
        low, high: Its corners in [m], shape (3,).
        rounded: Whether the true body is a round bar along the box's longest side that touches all six faces, its ends
            half balls; in a box of three like sides that is a ball.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    rounded: bool = False


@dataclass(frozen=True)
class KnownPart:
    """A part on a joint.

    Attributes:
        name: Of the joint.
        kind: Whether it turns ([rad]) or slides ([m]).
        anchor: Origin of its frame in the model's frame, shape (3,).
        axis: Unit vector of the joint, shape (3,).
        opened: Joint position at fraction 1; 0 is closed.
        boxes: In its own frame.
    """

    name: str
    kind: Literal["hinge", "slide"]
    anchor: NDArray[np.float64]
    axis: NDArray[np.float64]
    opened: float
    boxes: tuple[KnownBox, ...]

    def model_T_part(self, fraction: float) -> np.ndarray:
        """Pose of its frame in the model's at a fraction 0 closed .. 1 open, shape (4, 4)."""
        pose = np.eye(4)
        pose[:3, 3] = self.anchor
        if self.kind == "slide":
            pose[:3, 3] += fraction * self.opened * self.axis
        else:
            pose[:3, :3] = _turn(self.axis, fraction * self.opened)
        return pose


@dataclass(frozen=True)
class KnownModel:
    """One thing of known shape.

    Attributes:
        name: Scene name.
        extents: Full sizes of its box in [m], shape (3,); parts may reach beyond it.
        boxes: Fixed ones, in the model's frame.
        parts: What moves.
    """

    name: str
    extents: NDArray[np.float64]
    boxes: tuple[KnownBox, ...]
    parts: tuple[KnownPart, ...] = ()

    @property
    def reach(self) -> float:
        """Radius in [m] of a sphere around the frame's origin that holds it, however far its parts are open."""
        fixed = [np.maximum(np.abs(b.low), np.abs(b.high)) for b in self.boxes]
        radius = max((float(np.linalg.norm(c)) for c in fixed), default=0.0)
        for part in self.parts:
            size = max(float(np.linalg.norm(np.maximum(np.abs(b.low), np.abs(b.high)))) for b in part.boxes)
            way = part.opened if part.kind == "slide" else 0.0
            radius = max(radius, float(np.linalg.norm(part.anchor)) + size + way)
        return radius

    def standing(self, x: float, y: float, yaw: float, support: float) -> np.ndarray:
        """world_T_model of the model standing at (x, y) [m] on a support of that height [m], shape (4, 4)."""
        pose = np.eye(4)
        pose[:3, :3] = _turn(np.array([0.0, 0.0, 1.0]), yaw)
        pose[:3, 3] = x, y, support + self.extents[2] / 2
        return pose

    def groups(self, fractions: np.ndarray) -> Iterator[tuple[np.ndarray, tuple[KnownBox, ...]]]:
        """Frames (model_T_frame) with the boxes in them: the fixed ones first, then one group a part.

        Args:
            fractions: One a part, shape (len(parts),).
        """
        yield np.eye(4), self.boxes
        for part, fraction in zip(self.parts, fractions, strict=True):
            yield part.model_T_part(float(fraction)), part.boxes

    def carriers(self, world_T_model: np.ndarray) -> tuple[Solid, ...]:
        """Its fixed boards as solids in the world, on whose tops things may stand."""
        yaw = float(np.arctan2(world_T_model[1, 0], world_T_model[0, 0]))
        return tuple(
            Solid("box", world_T_model[:3, :3] @ ((b.low + b.high) / 2) + world_T_model[:3, 3], yaw, b.high - b.low)
            for b in self.boxes
        )


def _turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation about a unit axis (Rodrigues), shape (3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
