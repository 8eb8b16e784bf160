"""Things that nobody named: depth that nothing explains, as estimates with names that last from look to look."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from perception.estimates import Evidence, ObjectEstimate, SceneEstimate
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.solids import Solid
from perception.known_shapes.models import KnownModel
from perception.unexplained.clusters import Unexplained, clusters, unexplained_points
from perception.unexplained.explanations import Explanation, explained_by
from perception.unexplained.hulls import Hull, hulls_of
from perception.unexplained.regions import Region

UNNAMED = "unnamed"  # names are unnamed_1, unnamed_2, ...
THIN = 0.005  # [m]: side of the cells that points are thinned to before a hull is fitted
# A cluster that touches a named thing and reaches less far beyond it than this, in [m], is that thing's own remainder:
# a handle, a stem, what blurred depth leaves.
REMAINDER = 0.025
REACH = 0.15  # [m] beyond the box that the hand stays in: what stands there can still be met by the arm
STOOD = 0.06  # [m] within which a thing of the last look is the same
MOVED_SIZE = 0.3  # share by which the volume of a thing that was moved may seem to change
CALIBRATION_STD = 0.003  # [m]


@dataclass(frozen=True)
class Known:
    """What a look is explained with besides its named things.

    Attributes:
        low, high: Corners of the box in which depth matters, in the world in [m], shape (3,): the box that the hand
            stays in; `REACH` is added.
        robot: Where the robot is, with what it holds, or None.
        furniture: Of known shape, by name.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    robot: Region | None = None
    furniture: Mapping[str, KnownModel] = field(default_factory=lambda: MappingProxyType({}))


class UnnamedThings:
    """Finds what nobody named, and goes on calling it by the same names. One a run."""

    def __init__(self) -> None:
        """Nothing has been seen yet."""
        self._called: dict[str, ObjectEstimate] = {}

    def added(self, scene: SceneEstimate, frames: Sequence[PreparedFrame], known: Known) -> SceneEstimate:
        """The scene with everything that depth shows beyond it.

        Args:
            scene: What is known to be there: found by name in the same frames, or earlier and unmoved.
            frames: Of one moment.
            known: What else explains depth.
        """
        seeing = [frame for frame in frames if frame.valid_depth.any()]
        found = unnamed_things(scene, seeing, known)
        return replace(scene, objects=(*scene.objects, *self._named(found, scene.names)))

    def _named(self, found: Sequence[ObjectEstimate], taken: Collection[str]) -> list[ObjectEstimate]:
        """The same estimates with names: those of the things they were before, else new ones, none that is taken."""
        free = {name: o for name, o in self._called.items() if name not in taken}
        names = _assigned(found, free, _apart, STOOD)
        left = [i for i in range(len(found)) if i not in names]
        gone = {n: o for n, o in free.items() if n not in names.values()}
        # What stood elsewhere is taken for the same thing where its size is: it was moved.
        moved = _assigned([found[i] for i in left], gone, _unlike, MOVED_SIZE)
        names |= {left[i]: name for i, name in moved.items()}
        number = max((int(n.rsplit("_", 1)[1]) for n in self._called), default=0)
        out = []
        for i, o in enumerate(found):
            if i not in names:
                number += 1
                names[i] = f"{UNNAMED}_{number}"
            out.append(replace(o, name=names[i], phrase=names[i].replace("_", " ")))
        self._called |= {o.name: o for o in out}
        return out


def unnamed_things(scene: SceneEstimate, frames: Sequence[PreparedFrame], known: Known) -> list[ObjectEstimate]:
    """Estimates of what depth shows beyond a scene, largest first; all of one name, "unnamed".

    Args:
        scene: What was found by name in the same frames.
        frames: Of one moment, each with some depth.
        known: What else explains depth.
    """
    explained = explained_by(scene.objects, known.furniture, known.robot)
    named = explained_by([o for o in scene.objects if o.name not in known.furniture], {}, None)
    low, high = np.asarray(known.low) - REACH, np.asarray(known.high) + REACH
    rest = unexplained_points(frames, scene.support_height, explained, low, high)
    carriers = _carriers(scene, known.furniture)
    solids = [_box_of(o) for o in scene.objects if o.name not in known.furniture]
    found = []
    for cluster in clusters(rest):
        if _is_remainder(cluster, named):
            continue
        std = float(np.median(cluster.std))
        for hull in hulls_of(_thinned(cluster.points), std, frames, carriers, scene.support_height):
            hull = replace(hull, solid=_beside(hull.solid, solids))
            found.append(_estimate(hull, std, cluster, frames, scene.stamp))
    return sorted(found, key=lambda o: -float(np.prod(o.extents)))


def _is_remainder(cluster: Unexplained, named: Sequence[Explanation]) -> bool:
    """Whether a cluster is what a named thing's solid leaves over: nowhere far from it."""
    for explanation in named:
        away = explanation.region.distance(cluster.points) - explanation.margin
        if float(np.quantile(away, 0.95)) < REMAINDER:
            return True
    return False


def _thinned(points: np.ndarray) -> np.ndarray:
    """The mean point of each small cell: cameras with many pixels on one side count no more than others."""
    _, owner = np.unique(np.floor(points / THIN).astype(np.int64), axis=0, return_inverse=True)
    owner = owner.ravel()
    count = np.bincount(owner)
    return np.stack([np.bincount(owner, weights=points[:, i]) / count for i in range(3)], axis=1)


def _carriers(scene: SceneEstimate, furniture: Mapping[str, KnownModel]) -> list[Solid]:
    out = []
    for o in scene.objects:
        model = furniture.get(o.name)
        out += [_box_of(o)] if model is None else model.carriers(o.world_T_object)
    return out


def _box_of(o: ObjectEstimate) -> Solid:
    return Solid("box", o.position, o.yaw, o.extents)


def _beside(hull: Solid, solids: Sequence[Solid]) -> Solid:
    """The hull without the slice by which it reaches into a named thing, where that costs less than a third of it.

    Points of the named thing are explained, so what overlaps is the margin of a box and not something seen.
    """
    for other in solids:
        if other.top <= hull.bottom + 0.002 or other.bottom >= hull.top - 0.002:
            continue
        hull = _cut_back(hull, other)
    return hull


def _cut_back(hull: Solid, other: Solid) -> Solid:
    turn = hull.pose[:3, :3]
    corners = np.array([[x, y, 0.0] for x in (-0.5, 0.5) for y in (-0.5, 0.5)]) * other.extents
    local = (corners @ other.pose[:3, :3].T + other.centre - hull.centre) @ turn
    low, high = local[:, :2].min(0), local[:, :2].max(0)
    half = hull.extents[:2] / 2
    into = np.array([high[0] + half[0], half[0] - low[0], high[1] + half[1], half[1] - low[1]])
    if np.any(into <= 0.0):
        return hull
    side = int(np.argmin(into))
    axis, sign = side // 2, (1.0 if side % 2 == 0 else -1.0)
    if into[side] > hull.extents[axis] / 3:
        return hull
    centre = np.array(hull.centre) + sign * into[side] / 2 * turn[:, axis]
    return replace(hull, centre=centre, extents=hull.extents - into[side] * np.eye(3)[axis])


def _estimate(
    hull: Hull, std: float, cluster: Unexplained, frames: Sequence[PreparedFrame], stamp: float
) -> ObjectEstimate:
    solid = hull.solid
    patches = max(1.0, float(cluster.weight.sum()))
    place = float(np.hypot(CALIBRATION_STD, std / np.sqrt(patches)))
    # A side that may be elsewhere moves the middle by half as much.
    along = np.abs(solid.pose[:2, :2]) @ (hull.size_std[:2] / 2 * (hull.size_std[:2] > std * 1.5))
    position_std = np.array([*np.hypot(place, along), float(np.hypot(place, hull.size_std[2] / 2))])
    longest = float(solid.extents[:2].max())
    evidence = tuple(e for frame in frames if (e := _evidence(frame, solid)) is not None)
    return ObjectEstimate(
        name=UNNAMED,
        phrase=UNNAMED,
        world_T_object=solid.pose,
        extents=np.asarray(solid.extents, float),
        shape="box",
        position_std=position_std,
        yaw_std=float(np.clip(2.0 * place / longest, 0.02, 0.5)),
        score=1.0,
        stamp=stamp,
        evidence=evidence,
        extents_std=hull.size_std,
        named=False,
    )


def _evidence(frame: PreparedFrame, solid: Solid) -> Evidence | None:
    """Pixels of known depth inside the hull, of every fourth row and column and those around them."""
    every = np.s_[::4, ::4]
    local = (frame.cloud[every] - solid.centre) @ solid.pose[:3, :3]
    with np.errstate(invalid="ignore"):
        inside = np.all(np.abs(local) < np.asarray(solid.extents) / 2 + 0.005, axis=-1)
    if inside.sum() < 3:
        return None
    mask = np.kron(inside, np.ones((4, 4), bool))[: frame.depth.shape[0], : frame.depth.shape[1]]
    v, u = np.nonzero(mask)
    box = np.array([u.min(), v.min(), u.max() + 1, v.max() + 1], float)
    return Evidence(frame.camera, box, mask, float(frame.valid_depth[mask].mean()), "depth that nothing explains")


def _assigned(found: Sequence[ObjectEstimate], called: Mapping[str, ObjectEstimate], cost, most: float):
    """Names by index of what was found: pairs of least total cost, none above `most`."""
    names = list(called)
    if not names or not found:
        return {}
    costs = np.array([[cost(o, called[name]) for name in names] for o in found])
    rows, columns = linear_sum_assignment(np.minimum(costs, 1e6))
    return {int(r): names[c] for r, c in zip(rows, columns, strict=True) if costs[r, c] <= most}


def _apart(a: ObjectEstimate, b: ObjectEstimate) -> float:
    return float(np.linalg.norm(a.position - b.position))


def _unlike(a: ObjectEstimate, b: ObjectEstimate) -> float:
    """Largest relative difference of the sorted sizes."""
    one, two = np.sort(a.extents), np.sort(b.extents)
    return float(np.max(np.abs(one - two) / np.maximum(one, two)))
