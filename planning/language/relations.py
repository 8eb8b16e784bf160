"""Spatial relations between perceived objects: on, in, next to. Needs numpy only.

All are computed from estimated boxes, with tolerances for 5 mm of pose error.

    a in b       a's centre is over b's footprint, a's footprint is smaller, and a's bottom is more than ON_TOLERANCE
                 below b's top
    a on b       a's centre is over b's footprint and |bottom(a) - top(b)| <= ON_TOLERANCE
    a in front of b  b has doors, a stands before them within their swing, overlaps them in width and reaches above
                 their lower edge
    a next to b  neither of these, the gap between the footprints is at most NEAR_GAP and their heights overlap
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from perception.estimates import ObjectEstimate, SceneEstimate
from planning.language.furnishings import Front

RelationKind = Literal["on", "in", "in front of", "next to"]
ON_TOLERANCE = 0.015  # [m], vertical: twice a 5 mm error of two heights, and slack
EDGE_TOLERANCE = 0.005  # [m] by which a centre may seem to lie outside the footprint that carries it
NEAR_GAP = 0.05  # [m], less than the width of an open gripper's fingers beside an object


@dataclass(frozen=True)
class Relation:
    """`a` is `kind` `b`."""

    kind: RelationKind
    a: str
    b: str

    def __str__(self) -> str:
        return f"{self.a} is {self.kind} {self.b}"


def find_relations(scene: SceneEstimate, fronts: Mapping[str, Front] | None = None) -> tuple[Relation, ...]:
    """All relations of a scene; next-to once per pair, the others from what is carried to what carries.

    Args:
        scene: What is seen.
        fronts: Of furniture with doors, by name; its frame has x from the front to the back.
    """
    fronts = fronts or {}
    found: list[Relation] = []
    objects = scene.objects
    for k, a in enumerate(objects):
        for b in objects[k + 1 :]:
            pair = _stacked(a, b) or _stacked(b, a) or _before(a, b, fronts) or _before(b, a, fronts)
            if pair is None and _beside(a, b):
                pair = Relation("next to", a.name, b.name)
            if pair is not None:
                found.append(pair)
    return tuple(found)


def _stacked(a: ObjectEstimate, b: ObjectEstimate) -> Relation | None:
    """The relation of a to b when b carries a."""
    if _outside(a.position[:2], b) > EDGE_TOLERANCE:
        return None
    bottom = a.top - float(a.extents[2])
    b_bottom = b.top - float(b.extents[2])
    if abs(bottom - b.top) <= ON_TOLERANCE:
        return Relation("on", a.name, b.name)
    smaller = float(np.prod(a.extents[:2])) < float(np.prod(b.extents[:2]))
    if smaller and b_bottom - ON_TOLERANCE <= bottom < b.top:
        return Relation("in", a.name, b.name)
    return None


def _before(a: ObjectEstimate, b: ObjectEstimate, fronts: Mapping[str, Front]) -> Relation | None:
    """Whether a stands where b's doors open into."""
    front = fronts.get(b.name)
    if front is None or a.name in fronts:
        return None
    b_bottom = b.top - float(b.extents[2])
    corners = (_footprint(a) - b.position[:2]) @ np.array(
        [[np.cos(b.yaw), -np.sin(b.yaw)], [np.sin(b.yaw), np.cos(b.yaw)]]
    )
    gap = -b.extents[0] / 2 - corners[:, 0].max()  # from the front to a's nearest point
    beside = np.abs(corners[:, 1]).min() > b.extents[1] / 2
    if gap < -b.extents[0] / 2 or gap > front.reach or beside or a.top <= b_bottom + front.low:
        return None
    return Relation("in front of", a.name, b.name)


def _beside(a: ObjectEstimate, b: ObjectEstimate) -> bool:
    overlap = min(a.top, b.top) - max(a.top - a.extents[2], b.top - b.extents[2])
    if overlap <= 0:
        return False
    gap = min(
        min(_outside(corner, b) for corner in _footprint(a)), min(_outside(corner, a) for corner in _footprint(b))
    )
    return gap <= NEAR_GAP


def _outside(point: np.ndarray, b: ObjectEstimate) -> float:
    """Horizontal distance in [m] of a point from b's footprint, 0 inside."""
    c, s = np.cos(b.yaw), np.sin(b.yaw)
    offset = np.asarray(point)[:2] - b.position[:2]
    half = np.asarray(b.extents)[:2] / 2
    if b.shape != "box":
        return float(max(0.0, np.linalg.norm(offset) - half.max()))
    local = np.array([c * offset[0] + s * offset[1], -s * offset[0] + c * offset[1]])
    return float(np.linalg.norm(np.maximum(np.abs(local) - half, 0.0)))


def _footprint(a: ObjectEstimate) -> np.ndarray:
    """Points on the rim of an object's footprint in the world in [m], shape (16, 2): corners and between them."""
    half = np.asarray(a.extents)[:2] / 2
    angles = np.arange(16) * np.pi / 8
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if a.shape == "box":
        ring = ring / np.abs(ring).max(axis=1, keepdims=True)
    c, s = np.cos(a.yaw), np.sin(a.yaw)
    return a.position[:2] + (ring * half) @ np.array([[c, s], [-s, c]])
