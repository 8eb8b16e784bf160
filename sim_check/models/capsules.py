"""Collision bodies of the robot: capsules around the round links, boxes around the base and the hand.

A capsule is the set of points within a radius r of a segment a-b. For a set of surface points P and k capsules the
fit looks for

    min  sum_i V(a_i, b_i, r_i)    with   min_i ( d(p, a_i b_i) - r_i ) <= 0   for every p in P,
    V(a, b, r) = pi r^2 |b - a| + 4/3 pi r^3

by alternating (as k-means does): every point goes to the capsule that contains it best, then every capsule is shrunk
around its own points (Nelder-Mead over a and b; the radius is the largest distance, so the points stay inside by
construction). Of several seeded starts the one whose union is smallest wins. The flat parts, base and hand, are cut
into slabs across the link's z axis, with one axis-aligned box around each: a capsule around the hand would reach into
the room of a 50 mm cube between the fingers.

The points are the vertices of the URDF's collision mesh (a coarse convex hull) and points all over its visual mesh
(the true surface, so that nothing between two hull vertices sticks out). The result is stored in
`panda_collision.json` because the fit takes a minute; `python -m sim_check.models.capsules` makes the file again.
"""

import itertools
import json
from pathlib import Path

import numpy as np

STORED = Path(__file__).with_name("panda_collision.json")
SEED = 7
STARTS = 16
CAPSULES_PER_LINK = {
    "panda_link1": 2,
    "panda_link2": 2,
    "panda_link3": 2,
    "panda_link4": 2,
    "panda_link5": 3,
    "panda_link6": 2,
    "panda_link7": 2,
}
# Heights in the link's frame at which a flat link is cut into slabs, in [m].
SLAB_CUTS = {
    "panda_link0": (0.02, 0.08),
    "panda_hand": (-0.0125, 0.0125),
}


def segment_distances(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distances of points, shape (n, 3), to the segment a-b (shapes (3,)), all in [m]; shape (n,)."""
    along = b - a
    share = np.clip((points - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.linalg.norm(points - a - share[:, None] * along, axis=1)


def outside(points: np.ndarray, capsules: np.ndarray) -> np.ndarray:
    """How far points stick out of a union of capsules.

    Args:
        points: Shape (n, 3), in [m].
        capsules: Rows (a, b, r), shape (k, 7), in [m], in the points' frame.

    Returns:
        Distance to the nearest capsule's surface in [m], negative inside; shape (n,).
    """
    return np.min([segment_distances(points, c[:3], c[3:6]) - c[6] for c in capsules], axis=0)


def union_volume(capsules: np.ndarray, spacing: float = 0.006) -> float:
    """Volume of a union of capsules, rows (a, b, r) of shape (k, 7), in [m^3], counted on a grid of `spacing`."""
    ends = np.concatenate([capsules[:, :3], capsules[:, 3:6]])
    reach = capsules[:, 6].max()
    axes = [np.arange(low, high, spacing) for low, high in zip(ends.min(0) - reach, ends.max(0) + reach, strict=True)]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return float(np.count_nonzero(outside(cells, capsules) <= 0.0)) * spacing**3


def _volume(length: float, radius: float) -> float:
    return np.pi * radius**2 * (length + 4.0 / 3.0 * radius)


def _shrink(points: np.ndarray, start: np.ndarray | None) -> np.ndarray:
    """Small capsule around points: row (a, b, r)."""
    from scipy.optimize import minimize

    if start is None:
        centre = points.mean(axis=0)
        axis = np.linalg.svd(points - centre, full_matrices=False)[2][0]
        reach = (points - centre) @ axis
        radius = np.linalg.norm(points - centre - reach[:, None] * axis, axis=1).max()
        low, high = min(reach.min() + radius, 0.0), max(reach.max() - radius, 0.0)
        start = np.concatenate([centre + low * axis, centre + high * axis])

    def cost(ends: np.ndarray) -> float:
        radius = segment_distances(points, ends[:3], ends[3:]).max()
        return _volume(float(np.linalg.norm(ends[3:] - ends[:3])), float(radius)) * 1e3  # litres

    # First steps of 10 mm: the default simplex (5 % of each number) would be flat where a coordinate is near zero.
    simplex = np.vstack([start, start + 0.01 * np.eye(6)])
    ends = minimize(
        cost, start, method="Nelder-Mead", options={"initial_simplex": simplex, "maxfev": 400, "xatol": 1e-5}
    ).x
    return np.concatenate([ends, [segment_distances(points, ends[:3], ends[3:]).max()]])


def fit_capsules(points: np.ndarray, count: int, rng: np.random.Generator, starts: int = STARTS) -> np.ndarray:
    """Few small capsules that together contain all points.

    Args:
        points: Surface points in [m], shape (n, 3).
        count: Number of capsules.
        rng: Chooses where each start places its first clusters.
        starts: Independent starts; the smallest union wins.

    Returns:
        Rows (a, b, r) in [m], shape (count, 7).

    Raises:
        ValueError: Fewer points than four per capsule.
    """
    if len(points) < 4 * count:
        raise ValueError(f"{len(points)} points are too few for {count} capsules; give at least {4 * count}")
    best, best_volume = None, np.inf
    for _ in range(starts):
        centres = points[rng.choice(len(points), count, replace=False)]
        owner = np.argmin(np.linalg.norm(points[:, None] - centres, axis=2), axis=1)
        fitted: list[np.ndarray] = []
        for _ in range(12):
            if min(np.bincount(owner, minlength=count)) < 4:
                break
            before = fitted or [None] * count
            fitted = [_shrink(points[owner == i], None if c is None else c[:6]) for i, c in enumerate(before)]
            moved = np.argmin([segment_distances(points, c[:3], c[3:6]) - c[6] for c in fitted], axis=0)
            if np.array_equal(moved, owner):
                break
            owner = moved
        if fitted and (volume := union_volume(np.array(fitted))) < best_volume:
            best, best_volume = np.array(fitted), volume
    if best is None:
        raise ValueError("no start gave every capsule four points; lower the count or add points")
    return best


def slab_boxes(points: np.ndarray, cuts: tuple[float, ...]) -> np.ndarray:
    """Axis-aligned boxes around slabs of points.

    Args:
        points: Surface points in [m], shape (n, 3), closer together than a slab is thick.
        cuts: Ascending z at which to cut, in [m].

    Returns:
        Rows (centre, half size) in [m], shape (len(cuts) + 1, 6); neighbours share the plane of their cut.
    """
    edges = [points[:, 2].min(), *cuts, points[:, 2].max()]
    rows = []
    for low, high in itertools.pairwise(edges):
        slab = points[(points[:, 2] >= low) & (points[:, 2] <= high)]
        lower, upper = np.append(slab[:, :2].min(axis=0), low), np.append(slab[:, :2].max(axis=0), high)
        rows.append(np.concatenate([(lower + upper) / 2, (upper - lower) / 2]))
    return np.array(rows)


def stored_capsules() -> dict[str, np.ndarray]:
    """The round links' capsules: link name → rows (a, b, r) in its frame in [m], shape (k, 7)."""
    return _stored("capsules")


def stored_boxes() -> dict[str, np.ndarray]:
    """The flat links' boxes: link name → rows (centre, half size) in its frame in [m], shape (k, 6)."""
    return _stored("boxes")


def _stored(kind: str) -> dict[str, np.ndarray]:
    return {name: np.array(rows) for name, rows in json.loads(STORED.read_text(encoding="utf-8"))[kind].items()}


def link_points(link: str, spacing: float = 0.006) -> np.ndarray:
    """Surface points of a link's collision and visual mesh in the link's frame, in [m], shape (n, 3).

    All vertices of the convex hull, and the visual surface at about one point in each cell of a grid of `spacing`.
    """
    import trimesh

    from control.robot.description_files import panda_description

    name = link.removeprefix("panda_")
    meshes = panda_description() / "meshes"
    hull = trimesh.load_mesh(meshes / "collision" / f"{name}.stl")
    surface = trimesh.load_scene(meshes / "visual" / f"{name}.dae").to_geometry()
    spread = trimesh.sample.sample_surface(surface, 40_000, seed=0)[0]
    points = np.vstack([surface.vertices, spread])  # pyright: ignore[reportAttributeAccessIssue]
    _, first = np.unique(np.round(points / spacing).astype(int), axis=0, return_index=True)
    return np.vstack([hull.vertices, trimesh.convex.convex_hull(points).vertices, points[np.sort(first)]])


def fit_link(link: str, seed: int = SEED) -> np.ndarray:
    """Capsules of one round link, rows (a, b, r) in [m] in the link's frame; the same for the same seed."""
    return fit_capsules(link_points(link), CAPSULES_PER_LINK[link], np.random.default_rng(seed))


def main() -> None:
    """Fit every link and write the stored file."""
    fitted = {
        "capsules": {link: fit_link(link) for link in CAPSULES_PER_LINK},
        "boxes": {link: slab_boxes(link_points(link), cuts) for link, cuts in SLAB_CUTS.items()},
    }
    kinds = []
    for kind, links in fitted.items():
        rows = {k: ",\n      ".join(json.dumps(r) for r in np.round(v, 5).tolist()) for k, v in links.items()}
        body = ",\n".join(f'    "{link}": [\n      {text}\n    ]' for link, text in rows.items())
        kinds.append(f'  "{kind}": {{\n{body}\n  }}')
    STORED.write_text("{\n" + ",\n".join(kinds) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
