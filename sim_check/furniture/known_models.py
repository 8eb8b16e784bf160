"""Furniture as perception knows it: the boards that a camera sees, and the joints that they move on."""

from collections.abc import Mapping

import numpy as np

from perception.known_shapes.models import KnownBox, KnownModel, KnownPart
from sim_check.cells.furniture_config import FurnitureConfig
from sim_check.furniture.build import furniture_model
from sim_check.furniture.model import Board, FurnitureModel
from sim_check.models.scene_mjcf import pose_of


def known_models(furniture: Mapping[str, FurnitureConfig]) -> dict[str, KnownModel]:
    """Known models of a cell's furniture, by name."""
    return {name: known_model(furniture_model(name, config)) for name, config in furniture.items()}


def known_model(thing: FurnitureModel) -> KnownModel:
    """The neutral description of one piece; panes without thickness and what is hidden are left out."""
    parts = tuple(KnownPart(p.name, p.kind, p.anchor, p.axis, p.opened, _boxes(p.boards)) for p in thing.parts)
    return KnownModel(thing.name, thing.extents, _boxes(thing.boards), parts)


def _boxes(boards: tuple[Board, ...]) -> tuple[KnownBox, ...]:
    return tuple(_box(b) for b in boards if b.solid_to_touch and b.look != "hidden")


def _box(board: Board) -> KnownBox:
    solid = board.solid
    half = solid.half.copy()
    if solid.kind == "capsule":
        half[2] += half[0]  # its round ends
    half = np.abs(pose_of(solid.position, solid.quat)[:3, :3]) @ half
    return KnownBox(solid.position - half, solid.position + half, rounded=solid.kind != "box")
