"""Limits along a start law as rows that a change of its pace must keep.

A start law goes along the path as s(p), at rest at both ends of p = 0..n cells. Played with a varying pace,
p'(t)^2 = b(p), it has with a = b' / 2 and d = b'' / 2

    p'' = a,   p''' = d sqrt(b)

and, with subscripts for derivatives with respect to p and tau = m p'' + c p'^2 + g for torques,

    acceleration    q_p a + q_pp b
    torque          m a + c b + g
    jerk            sqrt(b) (q_p d + 3 q_pp a + q_ppp b)
    torque rate     sqrt(b) (m d + (m_p + 2 c) a + c_p b + g_p)

Speed is a bound on b; the hand's linear and angular acceleration and jerk are vectors that follow the first and third
line with the hand's velocity and acceleration of the start law in place of q_p and q_pp. Since the start law rests at
its ends by itself, b is of moderate size everywhere, where the usual squared path speed s'^2 falls to zero.

b is a quadratic spline on the cells with coefficients beta (a hill each, three to a cell): a is linear and d constant
within a cell. Rows of speed, acceleration and torque stand at the nodes between cells, where a has its extremes; rows
of jerk and torque rate at both ends of each cell, as d differs from cell to cell.
"""

from dataclasses import dataclass, replace

import numpy as np

from control.motion_bounds import MotionBounds
from control.path_smoothing import SmoothPath
from control.robot import RobotModel
from control.start_law import StartLaw

# Groups of rows in the order of the blocks: name of the limit, joint (0 to 6) or None.
_JOINTS = range(7)
AT_NODES: tuple[tuple[str, int | None], ...] = (
    ("speed", None),
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
_NODE_SIZES = (1,) * 15 + (3, 3)
_CELL_SIZES = (1,) * 14 + (3, 3)


@dataclass(frozen=True)
class RowBlock:
    """Rows w at n points, of which each group (a scalar or a vector of three) must have a length of at most 1.

        w = (constant + sum_k coefficients[k] u_k) sqrt(u_0)^rate,   u_k = sum_j stencil[k, j] beta[i + j] at point i

    Attributes:
        stencil: From spline coefficients to b, a (and d), shape (k, j).
        coefficients: Relative to the limits, k arrays of shape (r, n).
        constant: Shape (r, n).
        sizes: Rows of each group, first all scalars (1), then all vectors (3).
        rate: Whether the rows carry the factor sqrt(b).
        tight: Factor on squared lengths by group and point, shape (groups, n), 1 = the limits themselves.
    """

    stencil: np.ndarray
    coefficients: tuple[np.ndarray, ...]
    constant: np.ndarray
    sizes: tuple[int, ...]
    rate: bool
    tight: np.ndarray

    def grouped(self, rows: np.ndarray) -> np.ndarray:
        """Sums over the rows of each group, (r, n) to (groups, n)."""
        scalars = self.sizes.count(1)
        vectors = rows[scalars:].reshape(-1, 3, rows.shape[1]).sum(axis=1)
        return np.concatenate([rows[:scalars], vectors])

    def values(self, beta: np.ndarray) -> list[np.ndarray]:
        """b, a (and d) at the points, k arrays of shape (n,)."""
        n = self.constant.shape[1]
        columns = [beta[j : j + n] for j in range(self.stencil.shape[1])]
        return [np.sum([w * c for w, c in zip(row, columns, strict=True) if w], axis=0) for row in self.stencil]

    def rows(self, u: list[np.ndarray]) -> np.ndarray:
        """w, shape (r, n), at the values u."""
        w = self.coefficients[0] * u[0]
        w += self.constant
        for c, x in zip(self.coefficients[1:], u[1:], strict=True):
            w += c * x
        if self.rate:
            w *= np.sqrt(u[0])
        return w

    def used(self, w: np.ndarray) -> np.ndarray:
        """Squared lengths of the groups, tightened, shape (groups, n)."""
        return self.grouped(w * w) * self.tight

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
    path: SmoothPath, start: StartLaw, robot: RobotModel, bounds: MotionBounds
) -> tuple[RowBlock, RowBlock, RowBlock]:
    """All rows along a start law.

    Returns:
        Rows at the nodes, and at the near and the far end of each cell; groups as in `AT_NODES` and `IN_CELLS`.
    """
    h = start.cell
    s, s1, s2, s3 = start.at_nodes()
    at, first, second, third = (path(s, order) for order in range(4))
    q, q1 = at, first * s1[:, None]
    q2 = second * (s1**2)[:, None] + first * s2[:, None]
    bend = third * (s1**3)[:, None] + 3.0 * second * (s1 * s2)[:, None]  # q_ppp without the start law's own jerk
    zero = np.zeros_like(q)
    g = robot.gravity(q)
    m, c = robot.torque(q, zero, q1) - g, robot.torque(q, q1, q2) - g
    velocity, acceleration = robot.tcp_motion(q, q1, q2)

    speed = np.max(np.abs(q1) / np.maximum(bounds.joint_speed(q, q1), 1e-9), axis=1)
    for part, limit in ((velocity[:, :3], bounds.hand[0]), (velocity[:, 3:], bounds.turn[0])):
        speed = np.maximum(speed, np.linalg.norm(part, axis=1) / limit)
    speed[[0, -1]] = 0.0  # at rest
    per_hand = np.repeat([bounds.hand, bounds.turn], 3, axis=0).T  # rows: speed, acceleration, jerk
    nodes = _block(
        np.array([[0.5, 0.5], [-0.5 / h, 0.5 / h]]),
        (
            (speed[:, None] ** 2, q2 / bounds.qdd, c / bounds.tau, acceleration / per_hand[1]),
            (0.0 * speed[:, None], q1 / bounds.qdd, m / bounds.tau, velocity / per_hand[1]),
        ),
        (0.0 * speed[:, None], zero, g / bounds.tau, 0.0 * velocity),
        _NODE_SIZES,
        rate=False,
    )

    def slope(values: np.ndarray) -> np.ndarray:
        return np.diff(values, axis=0) / h

    c_p, g_p, acceleration_p = slope(c), slope(g), slope(acceleration)
    m_p = np.zeros_like(m)  # continuous, as q_pp is, and 0 at the ends
    m_p[1:-1] = (m[2:] - m[:-2]) / (2.0 * h)
    bend_in_cell = np.array([0.5, -1.0, 0.5]) / h**2
    ends = []
    for end, near in ((slice(None, -1), 0), (slice(1, None), 1)):
        stencil = np.zeros((3, 3))
        stencil[0, near : near + 2] = 0.5
        stencil[1, near : near + 2] = -0.5 / h, 0.5 / h
        stencil[2] = bend_in_cell
        q3 = bend[end] + first[end] * s3[:, None]
        ends.append(
            _block(
                stencil,
                (
                    (q3 / bounds.qddd, c_p / bounds.taud, acceleration_p / per_hand[2]),
                    (
                        3.0 * q2[end] / bounds.qddd,
                        (m_p[end] + 2.0 * c[end]) / bounds.taud,
                        3.0 * acceleration[end] / per_hand[2],
                    ),
                    (q1[end] / bounds.qddd, m[end] / bounds.taud, velocity[end] / per_hand[2]),
                ),
                (zero[end], g_p / bounds.taud, 0.0 * velocity[end]),
                _CELL_SIZES,
                rate=True,
            )
        )
    return nodes, ends[0], ends[1]


def _block(stencil: np.ndarray, coefficients, constant, sizes: tuple[int, ...], rate: bool) -> RowBlock:
    def stacked(parts) -> np.ndarray:
        return np.ascontiguousarray(np.concatenate(parts, axis=1).T)

    constants = stacked(constant)
    tight = np.ones((len(sizes), constants.shape[1]))
    return RowBlock(stencil, tuple(stacked(part) for part in coefficients), constants, sizes, rate, tight)
