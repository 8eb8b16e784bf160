"""What a planner may know of the furniture of a cell: its joints, what they are for, and whether it has an inside.

All of it stands in the cell file or in the object library, as knowledge of kinds of furniture; how far a joint is open
and where a piece stands is perceived. Which lever draws which bolt stands nowhere.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from sim_check.cells.furniture_config import (
    CabinetConfig,
    FurnitureConfig,
    LeverConfig,
    MicrowaveConfig,
    WeightPlateConfig,
)

HAND_WIDTH = 0.2  # [m], of a Panda's hand across its fingers
JointRole = Literal["door", "lever", "plate"]


@dataclass(frozen=True)
class KnownJoint:
    """A joint of furniture.

    Attributes:
        name: As reward terms use it.
        owner: The furniture that it belongs to.
        role: `door` closes an inside; `lever` is pulled by hand; `plate` goes down under a weight.
    """

    name: str
    owner: str
    role: JointRole

    @property
    def by_hand(self) -> bool:
        """Whether a hand can drive it; a plate wants a weight."""
        return self.role != "plate"


@dataclass(frozen=True)
class Front:
    """The space before doors, that they and the hand need to open.

    Attributes:
        low: Height of the doors' lower edge above the table in [m].
        reach: How far it reaches out from the front in [m]: a hinged door's width, or a hand's at a sliding one.
    """

    low: float
    reach: float


@dataclass(frozen=True)
class KnownFurniture:
    """A piece of furniture.

    Attributes:
        name: Scene name.
        kind: As in the cell file, for instance "cabinet".
        joints: All that move.
        front: Where its doors open into; None for what has no inside.
    """

    name: str
    kind: str
    joints: tuple[KnownJoint, ...]
    front: Front | None = None

    @property
    def has_inside(self) -> bool:
        """Whether things can be in it, behind its doors."""
        return self.front is not None


def known_furniture(configs: Mapping[str, FurnitureConfig]) -> dict[str, KnownFurniture]:
    """What is known of a cell's furniture (the cell file's `furniture`), by name."""
    return {name: _known(name, config) for name, config in configs.items()}


def _known(name: str, config: FurnitureConfig) -> KnownFurniture:
    front = None
    match config:
        case CabinetConfig() | MicrowaveConfig():
            role: JointRole = "door"
            slides = isinstance(config, CabinetConfig) and config.opening == "sliding"
            reach = HAND_WIDTH if slides else config.width / len(config.part_names(name))
            front = Front(config.bottom, reach)
        case LeverConfig():
            role = "lever"
        case WeightPlateConfig():
            role = "plate"
    joints = tuple(KnownJoint(joint, name, role) for joint in config.part_names(name))
    return KnownFurniture(name, config.kind, joints, front)
