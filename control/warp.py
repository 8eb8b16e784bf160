"""The fastest pace at which a start law keeps its rows, by a primal-dual interior point method.

    minimise the duration T(beta) = sum_i weight_i / sqrt(beta_i)   subject to   f = (|w|^2 - 1) / 2 <= 0 for each group

with rows w(beta) as in `control.warp_rows`. With slacks s = -f and multipliers l, each iteration solves

    (T'' + sum l J^T J + (l / s) v v^T) step = -T' - sum (mu / s) v,   J = dw / dbeta,   v = J^T w

where the second derivatives of w (from the factor sqrt(b)) are left out: the matrix stays positive definite. It has
five diagonals, as a row knows three neighbouring coefficients, so an iteration takes time proportional to the number
of cells. mu goes to zero with s l. Every iterate is strictly inside the limits; the shortest is returned, however the
iteration ends. In the first and in the last cell the pace is even (three equal coefficients): everything rests at their
outer ends, so no row there would notice a jerk that has its extreme inside the cell.

Source: Nocedal and Wright, "Numerical Optimization", 2nd edition, chapter 19.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, solveh_banded

from control.start_law import StartLaw
from control.warp_rows import RowBlock

ITERATIONS = 40
CLOSE = 2e-3  # duality gap relative to the duration that ends the iteration
TO_THE_WALL = 0.97  # share of the way to the nearest limit that a step goes at most
FIRST_CENTRE, CENTRE = 0.1, 0.15  # mu of the start in durations per cell; factor by which it falls after a good step
GOOD_STEP, FAIR_STEP = 0.6, 0.2
SHRINK, SHRINKS = 0.6, 12  # of a step that would leave the limits
LEAST_SLACK = 0.02  # share of a slack that one step must leave
SUBCELLS = 8  # parts of a cell between which p(t) is a polynomial of fifth degree
_GAUSS = np.polynomial.legendre.leggauss(3)


def room(blocks: Sequence[RowBlock], beta: np.ndarray) -> float:
    """Largest squared length of any group at an even pace in the end cells: below 1 all limits are kept."""
    beta = _even_ends(beta)
    return max(float(block.used(block.rows(block.values(beta))).max()) for block in blocks)


def fastest_pace(blocks: Sequence[RowBlock], cell: float, beta: np.ndarray) -> np.ndarray:
    """Coefficients of the fastest pace.

    Args:
        blocks: What has to be kept.
        cell: Length of a cell in [s].
        beta: Coefficients to start from, positive and strictly within all limits, also with an even pace in the first
            and in the last cell, shape (n + 2,).

    Returns:
        Coefficients of the same shape that are not slower and strictly within the limits as well.
    """
    weight = np.full(len(beta), cell)
    weight[[0, -1]] /= 6.0
    weight[[1, -2]] *= 5.0 / 6.0
    beta = _even_ends(beta)

    def duration(beta: np.ndarray) -> float:
        return float(np.sum(weight / np.sqrt(beta)))

    state = [_State.of(block, beta) for block in blocks]
    count = sum(x.slack.size for x in state)
    best, shortest = beta, duration(beta)
    mu = FIRST_CENTRE * shortest / len(beta)
    multipliers = [mu / x.slack for x in state]
    for _ in range(ITERATIONS):
        matrix, gradient = np.zeros((3, len(beta))), -0.5 * weight * beta**-1.5
        matrix[2] = 0.75 * weight * beta**-2.5
        pushes = [x.add_to(matrix, gradient, y, mu) for x, y in zip(state, multipliers, strict=True)]
        try:
            step = _solve_tied(matrix, -gradient)
        except LinAlgError:  # lost to rounding: what was reached is as good as it gets
            break
        primal, dual = min(1.0, 0.9 / max(float(np.max(-step / beta)), 1e-12)), 1.0
        changes = []
        for x, y, push in zip(state, multipliers, pushes, strict=True):
            towards = x.towards(step, push)
            change = (mu + y * towards) / x.slack - y
            changes.append(change)
            primal = min(primal, TO_THE_WALL / max(float(np.max(towards / x.slack)), 1e-12))
            dual = min(dual, 0.95 / max(float(np.max(-change / y)), 1e-12))
        for _ in range(SHRINKS):
            moved = beta + primal * step
            trial = [_State.of(x.block, moved) for x in state] if moved.min() > 0.0 else []
            if trial and all(np.all(t.slack > LEAST_SLACK * x.slack) for t, x in zip(trial, state, strict=True)):
                break
            primal *= SHRINK
        else:
            break
        beta, state = moved, trial
        multipliers = [
            np.maximum(y + dual * change, 1e-3 * mu / x.slack)
            for x, y, change in zip(state, multipliers, changes, strict=True)
        ]
        now = duration(beta)
        if now < shortest:
            best, shortest = beta, now
        gap = sum(float(np.sum(x.slack * y)) for x, y in zip(state, multipliers, strict=True))
        if gap < CLOSE * now and primal > 0.5:
            break
        centred, reach = gap / count, min(primal, dual)
        if reach > FAIR_STEP:
            factor = CENTRE if reach > GOOD_STEP else 0.5
            mu = min(mu, max(factor * centred, 0.3 * CLOSE * now / count))
        else:
            mu = centred
    return best


def _even_ends(beta: np.ndarray) -> np.ndarray:
    """The same with an even pace in the first and in the last cell."""
    beta = beta.copy()
    beta[:3], beta[-3:] = beta[:3].min(), beta[-3:].min()
    return beta


def _solve_tied(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve a system of five diagonals, upper form, in which the first three unknowns are equal, and the last three."""
    for flip in (False, True):
        if flip:  # so that the end becomes the start: the matrix is symmetric
            matrix = np.stack([np.roll(row[::-1], 2 - k) for k, row in enumerate(matrix)])
            right = right[::-1]
        merged = matrix[:, 2:].copy()
        merged[2, 0] += matrix[2, 0] + matrix[2, 1] + 2.0 * (matrix[1, 1] + matrix[1, 2] + matrix[0, 2])
        merged[1, 1] += matrix[0, 3]
        matrix, right = merged, np.concatenate([[right[:3].sum()], right[3:]])
    step = solveh_banded(matrix, right, check_finite=False)[::-1]
    return np.concatenate([[step[0]] * 2, step, [step[-1]] * 2])


@dataclass(frozen=True)
class _State:
    """Rows of one block at one point of the iteration: values u of the spline, rows w, slacks of the groups."""

    block: RowBlock
    u: list[np.ndarray]
    w: np.ndarray
    slack: np.ndarray

    @classmethod
    def of(cls, block: RowBlock, beta: np.ndarray) -> "_State":
        u = block.values(beta)
        w = block.rows(u)
        return cls(block, u, w, 0.5 * (1.0 - block.used(w)))

    def add_to(self, matrix: np.ndarray, gradient: np.ndarray, multiplier: np.ndarray, mu: float) -> list[np.ndarray]:
        """Add this block's part to the banded matrix and the gradient; returns v by value of the spline."""
        block, n = self.block, self.slack.shape[1]
        jacobian = list(block.coefficients)
        if block.rate:
            root = np.sqrt(self.u[0])
            jacobian = [c * root for c in jacobian]
            jacobian[0] += 0.5 * self.w / self.u[0]
        push = [block.grouped(self.w * j) * block.tight for j in jacobian]
        weight = np.repeat(multiplier * block.tight, block.sizes, axis=0)
        pull, centre = multiplier / self.slack, mu / self.slack
        k = len(jacobian)
        local, slope = np.empty((k, k, n)), np.empty((k, n))
        for i in range(k):
            weighted, pulled = weight * jacobian[i], pull * push[i]
            for j in range(i, k):
                local[i, j] = local[j, i] = np.einsum("rn,rn->n", weighted, jacobian[j]) + np.einsum(
                    "gn,gn->n", pulled, push[j]
                )
            slope[i] = np.einsum("gn,gn->n", centre, push[i])
        stencil = block.stencil
        width = stencil.shape[1]
        spread = (np.kron(stencil, stencil).T @ local.reshape(k * k, n)).reshape(width, width, n)
        for a in range(width):
            gradient[a : a + n] += stencil[:, a] @ slope
            for b in range(a, width):
                matrix[2 - (b - a), b : b + n] += spread[a, b]
        return push

    def towards(self, step: np.ndarray, push: list[np.ndarray]) -> np.ndarray:
        """By how much a step of the coefficients takes slack away, to first order."""
        change = self.block.values(step)
        return sum(p * c for p, c in zip(push, change, strict=True))  # type: ignore[return-value]


@dataclass(frozen=True)
class Warp:
    """A start law played at a pace: a time law from rest to rest.

    Attributes:
        start: The start law.
        beta: Coefficients of b = p'^2, a quadratic spline on its cells, positive, shape (n + 2,).
    """

    start: StartLaw
    beta: np.ndarray

    def passed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Times t in [s] at which the parts of cells begin and end, and p, p', p'' there, each of shape (k,)."""
        n, h = self.start.cells, self.start.cell
        y = np.arange(SUBCELLS) / SUBCELLS
        inside = ((_GAUSS[0] + 1.0) / 2.0 + np.arange(SUBCELLS)[:, None]) / SUBCELLS
        slowness = 1.0 / np.sqrt(self._square(inside.ravel())).reshape(n, SUBCELLS, 3)
        steps = slowness @ (_GAUSS[1] / 2.0) * (h / SUBCELLS)
        t = np.concatenate([[0.0], np.cumsum(steps.ravel())])
        p = np.arange(n * SUBCELLS + 1) * (h / SUBCELLS)
        end = (self.beta[-1] + self.beta[-2]) / 2.0
        speed = np.sqrt(np.append(self._square(y).ravel(), end))
        before, here, after = self.beta[:-2, None], self.beta[1:-1, None], self.beta[2:, None]
        bend = ((here - before) * (1.0 - y) + (after - here) * y) / (2.0 * h)
        return t, p, speed, np.append(bend.ravel(), (self.beta[-1] - self.beta[-2]) / (2.0 * h))

    def _square(self, y: np.ndarray) -> np.ndarray:
        """b at shares y of each cell, shape (n, k)."""
        before, here, after = self.beta[:-2, None], self.beta[1:-1, None], self.beta[2:, None]
        return 0.5 * (before * (1.0 - y) ** 2 + here * (1.0 + 2.0 * y - 2.0 * y**2) + after * y**2)

    @property
    def duration(self) -> float:
        """From rest to rest in [s]."""
        return float(self.passed()[0][-1])

    def parameter(self, t: np.ndarray) -> np.ndarray:
        """p at times in [s], shape (k,), by polynomials that agree with p, p' and p'' at both ends of each part."""
        times, p, speed, bend = self.passed()
        k = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        length = times[k + 1] - times[k]
        y = np.clip((t - times[k]) / length, 0.0, 1.0)
        way = p[k + 1] - p[k]
        v0, v1 = speed[k] * length, speed[k + 1] * length
        a0, a1 = bend[k] * length**2, bend[k + 1] * length**2
        c3 = 10.0 * way - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
        c4 = -15.0 * way + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1
        c5 = 6.0 * way - 3.0 * v0 - 3.0 * v1 - 0.5 * a0 + 0.5 * a1
        return p[k] + y * (v0 + y * (0.5 * a0 + y * (c3 + y * (c4 + y * c5))))

    def progress(self, t: np.ndarray) -> np.ndarray:
        """Progress s along the path at times in [s], shape (k,)."""
        return self.start(self.parameter(t))
