"""What bodies are made of: convex primitives, and a body as a model builds it. Lengths in [m]."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from control.twin_model import Handle

SolidKind = Literal["box", "sphere", "ellipsoid", "cylinder", "capsule"]


@dataclass(frozen=True)
class SolidShape:
    """One primitive of an object's collision body.

    Attributes:
        kind: Which primitive; a cylinder's and a capsule's axis is its z.
        half: Half sizes in [m], shape (3,); a cylinder is (radius, radius, half height), a capsule (radius, radius,
            half of its straight part).
        position: Its centre in the object's frame in [m], shape (3,).
        quat: Its orientation in the object's frame, (w, x, y, z).
    """

    kind: SolidKind
    half: NDArray[np.float64]
    position: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    quat: NDArray[np.float64] = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))

    @property
    def volume(self) -> float:
        """In [m^3]."""
        if self.kind == "capsule":
            radius, half = self.half[0], self.half[2]
            return float(2 * np.pi * radius**2 * half + 4 / 3 * np.pi * radius**3)
        factor = {"box": 8.0, "sphere": 4 / 3 * np.pi, "ellipsoid": 4 / 3 * np.pi, "cylinder": 2 * np.pi}[self.kind]
        return float(factor * np.prod(self.half))


@dataclass(frozen=True)
class Built:
    """A body as it is built in the sizes that were asked for.

    Attributes:
        solids: Its primitives.
        extents: Full sizes along its own axes in [m], shape (3,); sides that the form has equal are made so.
        inner_floor: Height of a vessel's inner floor above its lowest point in [m], else 0.
        inner_radius: Radius of a vessel's opening in [m], else 0.
        handle: What to take hold of when the whole is too wide for the gripper, or None.
    """

    solids: tuple[SolidShape, ...]
    extents: NDArray[np.float64]
    inner_floor: float = 0.0
    inner_radius: float = 0.0
    handle: Handle | None = None
