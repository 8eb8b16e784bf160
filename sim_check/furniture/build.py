"""From a description in a cell file to furniture that can be built."""

from sim_check.cells.furniture_config import (
    CabinetConfig,
    FurnitureConfig,
    LeverConfig,
    MicrowaveConfig,
    WeightPlateConfig,
)
from sim_check.furniture.doors import build_cabinet
from sim_check.furniture.mechanisms import build_lever, build_weight_plate
from sim_check.furniture.model import FurnitureModel


def furniture_model(name: str, config: FurnitureConfig) -> FurnitureModel:
    """The parametric model of a piece of furniture.

    Args:
        name: Scene name; names of joints begin with it: `NAME_left_door` and `NAME_right_door` of two doors,
            `NAME_door` of a single one (hinged or sliding), `NAME_rod` of a lever.
        config: Kind and sizes.
    """
    match config:
        case CabinetConfig() | MicrowaveConfig():
            return build_cabinet(name, config)
        case LeverConfig():
            return build_lever(name, config)
        case WeightPlateConfig():
            return build_weight_plate(name, config)
