"""Free ways between two configurations: straight in joint space, through a waypoint, or by RRT-connect.

Paths are dense, shape (n, 7) in [rad], with both ends. Budgets count configurations looked at, never seconds, so that
the same seed gives the same path on any machine.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from control.robot.limits import RobotLimits

WAYPOINT_STEP = 0.05  # [rad], largest joint motion between neighbouring waypoints
TREE_STEP = 0.35  # [rad], largest joint motion of one growth of a tree
SHORTCUTS = 40

Clear = Callable[[np.ndarray], bool]


def straight(start: np.ndarray, end: np.ndarray, step: float = WAYPOINT_STEP) -> np.ndarray:
    """Waypoints of a straight line in joint space, ends included, shape (n >= 2, 7)."""
    count = max(2, int(np.ceil(np.abs(end - start).max() / step)) + 1)
    share = np.linspace(0.0, 1.0, count)[:, None]
    return start * (1 - share) + end * share


def join(points: Sequence[np.ndarray], step: float = WAYPOINT_STEP) -> np.ndarray:
    """A polyline through points (7,), densely sampled, ends included, shape (n, 7)."""
    pieces = [straight(a, b, step) for a, b in pairwise(points)]
    return np.vstack([pieces[0], *(p[1:] for p in pieces[1:])])


def all_clear(path: np.ndarray, clear: Clear) -> bool:
    """Whether every waypoint is free; the middle and a coarse selection are looked at first."""
    n = len(path)
    seen = list(dict.fromkeys([n // 2, n - 1, *range(0, n, 4), *range(n)]))
    return all(clear(path[i]) for i in seen)


def free_path(start: np.ndarray, end: np.ndarray, clear: Clear, vias: Sequence[np.ndarray]) -> np.ndarray | None:
    """The straight way, else the first free one through a waypoint; None when all are obstructed.

    Args:
        start, end: Configurations in [rad], shape (7,).
        clear: Whether a configuration is free.
        vias: Waypoints to try, in order.
    """
    for points in ([start, end], *([start, via, end] for via in vias)):
        path = join(points)
        if all_clear(path, clear):
            return path
    return None


def rrt_connect(
    start: np.ndarray,
    end: np.ndarray,
    clear: Clear,
    limits: RobotLimits,
    rng: np.random.Generator,
    budget: int = 4000,
) -> np.ndarray | None:
    """A free way found by two trees that grow towards each other, shortened afterwards.

    Source: J. J. Kuffner and S. M. LaValle, "RRT-Connect: An efficient approach to single-query path planning", 2000.

    Args:
        start, end: Configurations in [rad], shape (7,).
        clear: Whether a configuration is free.
        limits: Joint range to sample in.
        rng: Source of randomness.
        budget: Most configurations to look at.

    Returns:
        Dense waypoints, shape (n, 7), or None when the budget is spent.
    """
    spent = 0

    def edge(a: np.ndarray, b: np.ndarray) -> bool:
        nonlocal spent
        line = straight(a, b)[1:]
        spent += len(line)
        return all_clear(line, clear)

    if not clear(start) or not clear(end):
        return None
    low, high = limits.q_min + 0.05, limits.q_max - 0.05
    trees = [_Tree(start), _Tree(end)]
    middle = (start + end) / 2
    while spent < budget:
        wild = rng.random() < 0.4
        sample = rng.uniform(low, high) if wild else np.clip(middle + rng.normal(0, 0.7, 7), low, high)
        grown = trees[0].extend(sample, edge)
        if grown is not None:
            met = trees[1].connect(trees[0].nodes[grown], edge)
            if met is not None:
                first, second = trees[0].branch(grown), trees[1].branch(met)
                points = first[::-1] + second[1:]
                if not np.allclose(points[0], start):
                    points = points[::-1]
                return join(_shorten(points, edge, rng))
        trees.reverse()
    return None


class _Tree:
    def __init__(self, root: np.ndarray) -> None:
        self.nodes, self.parents = [np.asarray(root, float)], [-1]

    def nearest(self, q: np.ndarray) -> int:
        return int(np.argmin(np.abs(np.array(self.nodes) - q).max(axis=1)))

    def extend(self, target: np.ndarray, edge: Callable[[np.ndarray, np.ndarray], bool]) -> int | None:
        i = self.nearest(target)
        move = target - self.nodes[i]
        size = np.abs(move).max()
        if size < 1e-9:
            return None
        node = self.nodes[i] + move * min(1.0, TREE_STEP / size)
        if not edge(self.nodes[i], node):
            return None
        self.nodes.append(node)
        self.parents.append(i)
        return len(self.nodes) - 1

    def connect(self, target: np.ndarray, edge: Callable[[np.ndarray, np.ndarray], bool]) -> int | None:
        while True:
            i = self.extend(target, edge)
            if i is None:
                return None
            if np.allclose(self.nodes[i], target):
                return i

    def branch(self, i: int) -> list[np.ndarray]:
        out = []
        while i >= 0:
            out.append(self.nodes[i])
            i = self.parents[i]
        return out


def _shorten(
    points: list[np.ndarray], edge: Callable[[np.ndarray, np.ndarray], bool], rng: np.random.Generator
) -> list[np.ndarray]:
    """Cut corners wherever the straight way between two waypoints is free."""
    for _ in range(SHORTCUTS):
        if len(points) < 3:
            break
        a, b = sorted(rng.choice(len(points), 2, replace=False))
        if b - a > 1 and edge(points[a], points[b]):
            points = points[: a + 1] + points[b:]
    return points
