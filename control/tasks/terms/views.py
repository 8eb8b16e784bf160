"""What a reward term is told: a scene to be judged, simulated motions to be costed, sizes and places."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from control.tasks.posed_object import PosedObject


@dataclass(frozen=True)
class TermJudgement:
    """Whether one term is met.

    Attributes:
        met: Whether it is.
        residual: Distance left to go in [m], of a joint the share of its range; 0 exactly when met.
        text: One sentence for people.
    """

    met: bool
    residual: float
    text: str


@dataclass(frozen=True)
class SceneState:
    """One moment, of the twin or as perceived.

    Attributes:
        objects: Everything in the scene by name.
        palm: Tool centre point in the world in [m], shape (3,).
        rest_palm: Where the tool centre point is in the rest configuration in [m], shape (3,).
        start_objects: The scene before the motion, or None where nothing is known of it.
        support_height: Height of the table top in [m].
        fractions: How far each joint is open, 0 closed .. 1 open, by name.
    """

    objects: Mapping[str, PosedObject]
    palm: NDArray[np.float64]
    rest_palm: NDArray[np.float64]
    start_objects: Mapping[str, PosedObject] | None
    support_height: float
    fractions: Mapping[str, float]


class SampledMotions(Protocol):
    """n simulated motions of t samples each.

    Attributes:
        start: The scene before the motions, by name.
        palm: Tool centre points in the world in [m], shape (n, t, 3).
        rest_palm: Tool centre point in the rest configuration in [m], shape (3,).
        support_height: Height of the table top in [m].
    """

    @property
    def start(self) -> Mapping[str, PosedObject]:
        """See the class."""
        ...

    @property
    def palm(self) -> np.ndarray:
        """See the class."""
        ...

    @property
    def rest_palm(self) -> np.ndarray:
        """See the class."""
        ...

    @property
    def support_height(self) -> float:
        """See the class."""
        ...

    def place(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Centres (n, t, 3) in [m] and rotations (n, t, 3, 3) of an object; of a fixed one (1, 1, ...)."""
        ...

    def handle_way(self, joint: str, fraction: float) -> np.ndarray:
        """Way in [m] that a joint's handle has still to go to a fraction of its range, shape (n, t)."""
        ...


@dataclass(frozen=True)
class Layout:
    """Sizes and places before any motion, for terms that cannot be met together.

    Attributes:
        objects: What is known, by name; empty where only the terms themselves are compared.
        table: Height of the table top in [m], or None where it is not known.
    """

    objects: Mapping[str, PosedObject]
    table: float | None
