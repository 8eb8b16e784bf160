"""Limits along an initial guess as rows that bound the parameter speed p'(t).

An initial guess goes along the path as s(p), at rest at both ends of p = 0..n cells. With a varying parameter speed,
p'(t)^2 = b(p), and with a = b' / 2 and d = b'' / 2, it has

    p'' = a,   p''' = d sqrt(b)

and, with subscripts for derivatives with respect to p and tau = m p'' + c p'^2 + g for torques,

    acceleration    q_p a + q_pp b
    torque          m a + c b + g
    jerk            sqrt(b) (q_p d + 3 q_pp a + q_ppp b)
    torque rate     sqrt(b) (m d + (m_p + 2 c) a + c_p b + g_p)

Speed is a bound on b. The hand's linear and angular acceleration and jerk are vectors; they follow the first and third
line with the hand's velocity and acceleration of the initial guess in place of q_p and q_pp. The initial guess rests at
its ends by itself. Therefore b is of moderate size everywhere, where the usual squared path speed s'^2 falls to zero.

b is a quadratic spline on the cells with coefficients beta (a hill each, three to a cell): a is linear and d constant
within a cell. Rows of speed, acceleration and torque stand at the nodes between cells, where a has its extremes; rows
of jerk and torque rate at both ends of each cell, as d differs from cell to cell.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from control.retiming.bounds import MotionBounds
from control.retiming.initial_guess import InitialGuess
from control.retiming.path_smoothing import SmoothPath
from control.robot.dynamics import RobotModel

# Groups of rows in the order of the blocks: name of the limit, joint (0 to 6) or None.
_JOINTS = range(7)
AT_NODES: tuple[tuple[str, int | None], ...] = (
    ("joint_velocity", None),
    ("hand_speed", None),
    *(("joint_acceleration", joint) for joint in _JOINTS),
    *(("torque", joint) for joint in _JOINTS),
    ("hand_acceleration", None),
    ("hand_angular_acceleration", None),
)
IN_CELLS: tuple[tuple[str, int | None], ...] = (
    *(("joint_jerk", joint) for joint in _JOINTS),
    *(("torque_rate", joint) for joint in _JOINTS),
    ("hand_jerk", None),
    ("hand_angular_jerk", None),
)
_NODE_SIZES = (1,) * 16 + (3, 3)
_CELL_SIZES = (1,) * 14 + (3, 3)


@dataclass(frozen=True)
class RowBlock:
    """Rows w at n points, of which each group (a scalar or a vector of three) must have a length of at most 1.

        w = (constant + sum_k coefficients[k] u_k) sqrt(u_0)^rate,   u_k = sum_j stencil[e, k, j] beta[i + j]

    at the points (e, i): for the nodes e is 0; for the cells first all near ends, e = 0, then all far ends, e = 1.

    Attributes:
        stencil: From spline coefficients to b, a (and d), shape (ends, k, j).
        coefficients: Relative to the limits, k arrays of shape (r, n).
        constant: Shape (r, n).
        sizes: Rows of each group, first all scalars (1), then all vectors (3).
        rate: Whether the rows carry the factor sqrt(b).
        tight: Factor on squared lengths by group and point, shape (groups, n), 1 = the limits themselves.
    """

    stencil: NDArray[np.float64]
    coefficients: tuple[np.ndarray, ...]
    constant: NDArray[np.float64]
    sizes: tuple[int, ...]
    rate: bool
    tight: NDArray[np.float64]

    @property
    def places(self) -> int:
        """Nodes or cells that the block has points at."""
        return self.constant.shape[1] // len(self.stencil)

    @cached_property
    def scalars(self) -> int:
        """Number of groups, and of rows, that are scalars."""
        return self.sizes.count(1)

    @cached_property
    def spreading(self) -> np.ndarray:
        """From products x_ij = x_ji of parts i <= j of u to products of neighbouring coefficients, upper triangle.

        Shape (j (j + 1) / 2, k (k + 1) / 2 ends), the ends counting fastest.
        """
        stencil = self.stencil
        pairs = list(combinations_with_replacement(range(stencil.shape[1]), 2))
        return np.array(
            [
                [
                    end[i, a] * end[j, b] + (end[j, a] * end[i, b] if i != j else 0.0)
                    for i, j in pairs
                    for end in stencil
                ]
                for a, b in combinations_with_replacement(range(stencil.shape[2]), 2)
            ]
        )

    def grouped(self, rows: np.ndarray) -> np.ndarray:
        """Sums over the rows of each group, (r, n) to (groups, n)."""
        scalars = self.scalars
        if scalars == len(rows):
            return rows
        vectors = rows[scalars:].reshape(-1, 3, rows.shape[1]).sum(axis=1)
        return np.concatenate([rows[:scalars], vectors])

    def values(self, beta: np.ndarray) -> np.ndarray:
        """b, a (and d) at the points, shape (k, n)."""
        places, width = self.places, self.stencil.shape[2]
        columns = np.empty((width, places))
        for j in range(width):
            columns[j] = beta[j : j + places]
        parts = [end @ columns for end in self.stencil]
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def linear(self, u: np.ndarray) -> np.ndarray:
        """The rows without the factor sqrt(b), shape (r, n), at the values u."""
        w = self.coefficients[0] * u[0]
        w += self.constant
        for c, x in zip(self.coefficients[1:], u[1:], strict=True):
            w += c * x
        return w

    def squares(self, linear: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Squared lengths of the groups, tightened, shape (groups, n), from `linear` rows at the values u."""
        factor = self.tight * u[0] if self.rate else self.tight
        return self.grouped(linear * linear) * factor

    def used(self, beta: np.ndarray) -> np.ndarray:
        """Squared lengths of the groups, tightened, shape (groups, n), at the coefficients beta."""
        u = self.values(beta)
        return self.squares(self.linear(u), u)

    def kept(self, groups: np.ndarray) -> "RowBlock":
        """The block with some groups only; groups is a mask."""
        rows = np.repeat(groups, self.sizes)
        return replace(
            self,
            coefficients=tuple(c[rows] for c in self.coefficients),
            constant=self.constant[rows],
            sizes=tuple(size for size, keep in zip(self.sizes, groups, strict=True) if keep),
            tight=self.tight[groups],
        )


def row_blocks(
    path: SmoothPath, start: InitialGuess, robot: RobotModel, bounds: MotionBounds
) -> tuple[RowBlock, RowBlock]:
    """All rows along an initial guess.

    Returns:
        Rows at the nodes, and at both ends of the cells; groups as in `AT_NODES` and `IN_CELLS`.
    """
    h = start.cell
    s, s1, s2, s3 = start.at_nodes()
    at, first, second, third = (path(s, order) for order in range(4))
    q, q1 = at, first * s1[:, None]
    q2 = second * (s1**2)[:, None] + first * s2[:, None]
    bend = third * (s1**3)[:, None] + 3.0 * second * (s1 * s2)[:, None]  # q_ppp without the initial guess's own jerk
    zero = np.zeros_like(q)
    g = robot.gravity(q)
    m, c = robot.torque(q, zero, q1) - g, robot.torque(q, q1, q2) - g
    velocity, acceleration = robot.tcp_motion(q, q1, q2)

    speed = np.zeros((len(s), 2))  # at rest in the first and in the last
    speed[1:-1, 0] = np.max(np.abs(q1) / np.maximum(bounds.joint_speed(q, q1), 1e-9), axis=1)[1:-1]
    for part, limit in ((velocity[:, :3], bounds.hand[0]), (velocity[:, 3:], bounds.turn[0])):
        speed[1:-1, 1] = np.maximum(speed[1:-1, 1], np.linalg.norm(part, axis=1)[1:-1] / limit)
    per_hand = np.repeat([bounds.hand, bounds.turn], 3, axis=0).T  # rows: speed, acceleration, jerk
    nodes = _block(
        np.array([[[0.5, 0.5], [-0.5 / h, 0.5 / h]]]),
        (
            (speed**2, q2 / bounds.qdd, c / bounds.tau, acceleration / per_hand[1]),
            (0.0 * speed, q1 / bounds.qdd, m / bounds.tau, velocity / per_hand[1]),
        ),
        (0.0 * speed, zero, g / bounds.tau, 0.0 * velocity),
        _NODE_SIZES,
        rate=False,
    )

    def slope(values: np.ndarray) -> np.ndarray:
        return np.diff(values, axis=0) / h

    c_p, g_p, acceleration_p = slope(c), slope(g), slope(acceleration)
    m_p = np.zeros_like(m)  # continuous, as q_pp is, and 0 at the ends
    m_p[1:-1] = (m[2:] - m[:-2]) / (2.0 * h)
    stencil = np.zeros((2, 3, 3))
    for near in (0, 1):
        stencil[near, 0, near : near + 2] = 0.5
        stencil[near, 1, near : near + 2] = -0.5 / h, 0.5 / h
        stencil[near, 2] = np.array([0.5, -1.0, 0.5]) / h**2

    def at_ends(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values[:-1], values[1:]])

    def twice(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, values])

    q3 = at_ends(bend) + at_ends(first) * twice(s3)[:, None]
    cells = _block(
        stencil,
        (
            (q3 / bounds.qddd, twice(c_p) / bounds.taud, twice(acceleration_p) / per_hand[2]),
            (
                3.0 * at_ends(q2) / bounds.qddd,
                at_ends(m_p + 2.0 * c) / bounds.taud,
                3.0 * at_ends(acceleration) / per_hand[2],
            ),
            (at_ends(q1) / bounds.qddd, at_ends(m) / bounds.taud, at_ends(velocity) / per_hand[2]),
        ),
        (at_ends(zero), twice(g_p) / bounds.taud, at_ends(0.0 * velocity)),
        _CELL_SIZES,
        rate=True,
    )
    return nodes, cells


def _block(stencil: np.ndarray, coefficients, constant, sizes: tuple[int, ...], rate: bool) -> RowBlock:
    def stacked(parts) -> np.ndarray:
        return np.ascontiguousarray(np.concatenate(parts, axis=1).T)

    constants = stacked(constant)
    tight = np.ones((len(sizes), constants.shape[1]))
    return RowBlock(stencil, tuple(stacked(part) for part in coefficients), constants, sizes, rate, tight)
