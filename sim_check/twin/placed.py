"""Things and where they are."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_check.furniture.model import FurnitureModel
from sim_check.objects.library import ObjectModel


@dataclass(frozen=True)
class Standing:
    """A thing and where it is.

    Attributes:
        thing: What it is.
        pose: Its frame in the world, shape (4, 4).
    """

    thing: ObjectModel
    pose: NDArray[np.float64]

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
    pose: NDArray[np.float64]
    fractions: dict[str, float]
