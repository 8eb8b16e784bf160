"""What explains depth: the support, the robot, furniture of known shape, and named things, each with its margin.

A point p with depth noise sigma along its ray is explained by something at distance d with margin m as far as

    z(p) = (d(p) - m) / sigma

is small: z counts by how many spreads the point lies outside of everything that is known. Of the support, d is the
height above it and sigma the part of the noise that is vertical. The least z of all explanations is the point's own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.estimates import ObjectEstimate
from perception.geometry.support import SupportPlane
from perception.known_shapes.models import KnownModel
from perception.unexplained.regions import PlacedSolid, Region, SolidsRegion

TABLE_MARGIN = 0.008  # [m]: a table's unevenness and the camera's calibration, as in `known_shapes.residual_clusters`
SURE = 2.0  # spreads by which what is known may be elsewhere
MOST_SPREAD = 0.03  # [m]: a thing that may be larger or elsewhere by more explains no more depth than that
# Handles are rounder than their boxes, vessels have spouts, and edges of depth are blurred, in [m].
FURNITURE_MARGIN, NAMED_MARGIN, ROBOT_MARGIN = 0.012, 0.012, 0.015
FAR_Z = 99.0  # of a point that is far from everything known


@dataclass(frozen=True)
class Explanation:
    """Something known that depth may show.

    Attributes:
        region: Where it is.
        margin: How far beyond it depth is still its own, apart from depth noise, in [m].
    """

    region: Region
    margin: float


def explained_by(
    objects: Sequence[ObjectEstimate], known: Mapping[str, KnownModel], robot: Region | None
) -> tuple[Explanation, ...]:
    """Explanations of a look.

    Args:
        objects: What was found by name. A hollow thing explains all of its box.
        known: Furniture of known shape, by name.
        robot: Where the robot is, with what it holds; None where there is none or nobody knows.
    """
    found = [] if robot is None else [Explanation(robot, ROBOT_MARGIN)]
    for o in objects:
        spread = SURE * float(np.max(o.position_std))
        model = known.get(o.name)
        if model is None:
            margin = NAMED_MARGIN + min(spread, MOST_SPREAD)
            found.append(Explanation(SolidsRegion((_solid_of(o),)), margin))
        else:
            found += _furniture(o, model, FURNITURE_MARGIN + min(spread, MOST_SPREAD))
    return tuple(found)


def unexplained_by(
    points: np.ndarray, std: np.ndarray, slope: np.ndarray, table: SupportPlane, known: Sequence[Explanation]
) -> NDArray[np.float32]:
    """The z of points, at most `FAR_Z`, shape (n,).

    Args:
        points: In the world in [m], shape (n, 3).
        std: Of their depth along the ray in [m], shape (n,).
        slope: Vertical part of each ray's direction, 0..1, shape (n,).
        table: The support as their picture shows it.
        known: What else explains them.
    """
    height = points[:, 2] - table.at(points[:, 0], points[:, 1]) - TABLE_MARGIN
    # A ray that is nearly level still errs in height: by the camera's tilt.
    z = np.minimum(height / (std * np.maximum(slope, 0.2)), FAR_Z).astype(np.float32)
    for explanation in known:
        open_ = np.flatnonzero(z > 0.0)
        if not len(open_):
            break
        own = (explanation.region.distance(points[open_]) - explanation.margin) / std[open_]
        z[open_] = np.minimum(z[open_], own)
    return z


def _solid_of(o: ObjectEstimate) -> PlacedSolid:
    """A named thing's solid, larger where its size is not sure."""
    more = np.zeros(3) if o.extents_std is None else np.minimum(SURE * o.extents_std, MOST_SPREAD)
    half = o.extents / 2 + more / 2
    kind = {"box": "box", "cylinder": "cylinder", "sphere": "ellipsoid"}[o.shape]
    if kind == "cylinder":
        half[:2] = half[:2].max()
    return PlacedSolid(kind, half, np.asarray(o.world_T_object))  # pyright: ignore[reportArgumentType]


def _furniture(o: ObjectEstimate, model: KnownModel, margin: float) -> list[Explanation]:
    """Its boards as they stand; a part that may be open by another share explains more around itself."""
    fractions = np.array([o.joint_fractions.get(part.name, 0.0) for part in model.parts])
    swing = [0.0, *(_sway(o, model, i) for i in range(len(model.parts)))]
    found = []
    for (frame, boxes), more in zip(model.groups(fractions), swing, strict=True):
        solids = tuple(_board(o.world_T_object @ frame, box.low, box.high) for box in boxes)
        if solids:
            found.append(Explanation(SolidsRegion(solids), margin + min(more, MOST_SPREAD)))
    return found


def _sway(o: ObjectEstimate, model: KnownModel, index: int) -> float:
    """How far the far end of a part may be from where it is said to be, in [m]."""
    part = model.parts[index]
    reach = max((float(np.abs(np.stack([b.low, b.high])).max()) for b in part.boxes), default=0.0)
    way = abs(part.opened) * (1.0 if part.kind == "slide" else reach)
    return SURE * o.joint_stds.get(part.name, 0.0) * way


def _board(pose: np.ndarray, low: np.ndarray, high: np.ndarray) -> PlacedSolid:
    placed = pose.copy()
    placed[:3, 3] = pose[:3, :3] @ ((low + high) / 2) + pose[:3, 3]
    return PlacedSolid("box", (high - low) / 2, placed)
