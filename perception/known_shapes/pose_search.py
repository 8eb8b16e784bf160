"""Where a thing of known shape may stand: a coarse search over all places and turns, without a detector.

Space is divided into small cubes, and each is judged by what the cameras saw along its line of sight: a surface there
(+1), a surface well behind it, so that it is empty (-1), or a surface before it (0, nothing is known). Points on the
model's faces collect these marks for every place (x, y) and turn; the best places are where faces are seen and where
nothing of the model stands in air that a camera looked through.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.geometry.depth_rays import DepthRays
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.solids import Solid
from perception.known_shapes.models import KnownBox, KnownModel

FRACTIONS = (0.0, 0.25, 0.5, 0.75, 1.0)  # of a joint that are tried
STRIDE = 2  # places are tried in steps of this many cubes


@dataclass(frozen=True)
class SearchSettings:
    """How coarse the search is.

    Attributes:
        cell: Largest side of the cubes in [m]; smaller for small models.
        turns: Number of yaws tried.
        samples: Points on the model's faces.
        kept: How many places are handed on.
        apart: Least distance in [m] between two of them that have the same turn.
        reach: How far beyond the seen points places are tried in [m].
    """

    cell: float = 0.02
    turns: int = 36
    samples: int = 160
    kept: int = 50
    apart: float = 0.045
    reach: float = 0.15


@dataclass(frozen=True)
class Marks:
    """What the cameras say about cubes of space.

    Attributes:
        low: Corner of the first cube in [m], shape (3,).
        cell: Side of a cube in [m].
        mark: From -1 empty over 0 unknown to +1 surface, shape (nx, ny, nz).
    """

    low: NDArray[np.float64]
    cell: float
    mark: NDArray[np.float32]

    def place(self, ix: int, iy: int, border: int) -> tuple[float, float]:
        """Place (x, y) in [m] of a step (ix, iy) of the grid of places inside of a rim of `border` cubes."""
        x, y = self.low[:2] + (np.array([ix, iy]) * STRIDE + border + 0.5) * self.cell
        return float(x), float(y)

    def at(self, points: np.ndarray) -> np.ndarray:
        """Marks at points in the world in [m], shape (..., 3) to (...); 0 outside."""
        index = np.floor((points - self.low) / self.cell).astype(np.int32)
        size = np.array(self.mark.shape)
        inside = np.all((index >= 0) & (index < size), -1)
        index = np.where(inside[..., None], index, 0)
        flat = (index[..., 0] * size[1] + index[..., 1]) * size[2] + index[..., 2]
        return np.where(inside, self.mark.ravel()[flat], 0.0)


def marked_space(frames: Sequence[PreparedFrame], low: np.ndarray, high: np.ndarray, cell: float) -> Marks:
    """Judge every cube between two corners.

    With b = cell + 2 sigma and s the measured minus the cube's depth, a camera's mark is 1 - (s/b)^2 where |s| < b,
    falls to -1 at s = 2 b, and is 0 where s < -b. Marks of several cameras are added and cut at -1 and 1.
    """
    size = np.maximum(np.ceil((high - low) / cell).astype(int), 1)
    steps = [low[i] + (np.arange(size[i]) + 0.5) * cell for i in range(3)]
    centres = np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, 3)
    total = np.zeros(len(centres))
    for frame in frames:
        k, pose = frame.intrinsics, frame.world_T_camera
        depth = np.where(frame.depth_steps(0.05), np.nan, frame.known_depth)
        local = (centres - pose[:3, 3]) @ pose[:3, :3]
        z = np.maximum(local[:, 2], 1e-3)
        u = np.round(k.fx * local[:, 0] / z + k.cx)
        v = np.round(k.fy * local[:, 1] / z + k.cy)
        seen = (local[:, 2] > 0.05) & (u >= 0) & (v >= 0) & (u < k.width) & (v < k.height)
        behind = depth[v[seen].astype(int), u[seen].astype(int)] - z[seen]
        wide = cell + 2.0 * frame.depth_std(1.0) * z[seen] ** 2
        share = behind / wide
        mark = np.where(np.abs(share) < 1.0, 1.0 - share**2, 0.0)
        mark = np.where(share >= 1.0, np.maximum(1.0 - share, -1.0), mark)
        total[seen] += np.nan_to_num(mark)
    return Marks(low, cell, np.clip(total, -1.0, 1.0).reshape(size).astype(np.float32))


def places(
    frames: Sequence[PreparedFrame],
    rays: DepthRays,
    model: KnownModel,
    support: float,
    taken: Sequence[Solid],
    settings: SearchSettings | None = None,
) -> list[np.ndarray]:
    """The likeliest (x, y in [m], yaw in [rad], fractions of the parts) of a standing model, best first.

    Args:
        frames: Pictures of one moment.
        rays: Their rays, to know where there is anything at all.
        model: What is looked for.
        support: Height of what it stands on in [m].
        taken: What was found already: no other thing has its middle there.
        settings: Of the search.
    """
    s = settings or SearchSettings()
    tall = float(model.extents[2])
    points = rays.points
    above = points[(points[:, 2] > support + min(0.03, 0.5 * tall)) & (points[:, 2] < support + tall + 0.03)]
    if len(above) < 20:
        return []
    first, last = np.quantile(above[:, :2], (0.005, 0.995), axis=0)
    low = np.array([*(first - s.reach), support])
    high = np.array([*(last + s.reach), support + tall + 0.03])
    cell = float(np.clip(model.extents.min() / 6, 0.008, s.cell))
    border = int(np.ceil(model.reach / cell)) + 1
    margin = np.array([border, border, 0.0]) * cell
    marks = marked_space(frames, low - margin, high + margin, cell)

    rng = np.random.default_rng(0)
    fixed = _face_points(model.boxes, s.samples, rng)
    # What lies on the support looks like the support, wherever it is put.
    fixed = fixed[fixed[:, 2] > min(cell, tall / 2) - tall / 2]
    parts = [_face_points(p.boxes, s.samples // 4, rng) for p in model.parts]
    closed = [p @ t.model_T_part(0.0)[:3, :3].T + t.anchor for p, t in zip(parts, model.parts, strict=True)]
    middle = support + tall / 2
    free = np.ones([-(-max(1, n - 2 * border) // STRIDE) for n in marks.mark.shape[:2]], bool)
    room = 0.4 * float(model.extents[:2].min())
    for ix, iy in np.ndindex(*free.shape):
        x, y = marks.place(ix, iy, border)
        free[ix, iy] = not any(t.covers(x, y, room) for t in taken)
    found = []
    for yaw in np.arange(s.turns) * 2.0 * np.pi / s.turns:
        score = _everywhere(marks, border, fixed, yaw, middle)
        for part in closed:
            score += np.maximum(_everywhere(marks, border, part, yaw, middle), 0.0)
        score[~free] = -np.inf
        for i in np.argsort(-score, axis=None)[: 2 * s.kept]:
            ix, iy = np.unravel_index(i, score.shape)
            found.append((float(score[ix, iy]), *marks.place(int(ix), int(iy), border), float(yaw)))
    # How far the parts are open changes what is expected, so the best places are judged again with each fraction.
    again = []
    for _, x, y, yaw in sorted(found, reverse=True)[: 10 * s.kept]:
        centre = np.array([x, y, middle])
        score, fractions = _here(marks, fixed, centre, yaw), []
        for points_of_part, part in zip(parts, model.parts, strict=True):
            opened = []
            for fraction in FRACTIONS:
                pose = part.model_T_part(fraction)
                opened.append(_here(marks, points_of_part @ pose[:3, :3].T + pose[:3, 3], centre, yaw))
            score += max(opened)
            fractions.append(FRACTIONS[int(np.argmax(opened))])
        again.append((score, x, y, yaw, *fractions))
    chosen: list[np.ndarray] = []
    for score, *start in sorted(again, reverse=True):
        if score <= 0 or len(chosen) >= s.kept:
            break
        x, y, yaw = start[:3]
        if all(np.hypot(x - c[0], y - c[1]) > s.apart or abs(np.sin((yaw - c[2]) / 2)) > 0.13 for c in chosen):
            chosen.append(np.array(start))
    return chosen


def _everywhere(marks: Marks, border: int, points: np.ndarray, yaw: float, middle: float) -> np.ndarray:
    """Sum of the marks at a turned model's points for every `STRIDE`-th place of a grid, shape (nx, ny).

    Args:
        marks: Of space.
        border: Width of the rim of cubes that are no places, in cubes; no point reaches farther.
        points: In the model's frame in [m], shape (m, 3).
        yaw: Of the model in [rad].
        middle: Height of the model's frame in the world in [m].
    """
    turned = points @ _about_z(yaw).T
    offset = np.round(turned[:, :2] / marks.cell).astype(int) + border
    level = np.floor((turned[:, 2] + middle - marks.low[2]) / marks.cell).astype(int)
    size = [max(1, n - 2 * border) for n in marks.mark.shape[:2]]
    score = np.zeros([-(-n // STRIDE) for n in size])
    for (dx, dy), iz in zip(offset, level, strict=True):
        if 0 <= iz < marks.mark.shape[2]:
            score += marks.mark[dx : dx + size[0] : STRIDE, dy : dy + size[1] : STRIDE, iz]
    return score


def _here(marks: Marks, points: np.ndarray, centre: np.ndarray, yaw: float) -> float:
    """Sum of the marks at a turned model's points around one centre."""
    return float(marks.at(points @ _about_z(yaw).T + centre).sum())


def _about_z(yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _face_points(boxes: tuple[KnownBox, ...], count: int, rng: np.random.Generator) -> np.ndarray:
    """Points spread over the faces of boxes by area, in their frame in [m], shape (count, 3)."""
    low, high = np.array([b.low for b in boxes]), np.array([b.high for b in boxes])
    size = high - low
    area = np.stack([size[:, 1] * size[:, 2], size[:, 0] * size[:, 2], size[:, 0] * size[:, 1]], -1)
    share = np.repeat(area.ravel(), 2)
    face = rng.choice(len(share), count, p=share / share.sum())
    box, axis, upper = face // 6, face // 2 % 3, face % 2
    points = low[box] + rng.random((count, 3)) * size[box]
    points[np.arange(count), axis] = np.where(upper, high[box, axis], low[box, axis])
    return points
