"""The shortest timing of an initial guess within its constraints, by a primal-dual interior point method.

    minimise the duration T(beta) = sum_i weight_i / sqrt(beta_i)   subject to   f = (|w|^2 - 1) / 2 <= 0 for each group

with rows w(beta) as in `control.retiming.constraints`. With slacks s = -f and multipliers l, each iteration solves

    (T'' + sum l J^T J + (l / s) v v^T) step = -T' - sum (mu / s) v,   J = dw / dbeta,   v = J^T w

where the second derivatives of w (from the factor sqrt(b)) are left out: the matrix stays positive definite. It has
five diagonals, as a row knows three neighbouring coefficients, so an iteration takes time proportional to the number
of cells. The barrier parameter mu goes to zero with s l. Every iterate is strictly inside the limits; the shortest is
returned, however the iteration ends. In the first and in the last cell the parameter speed is constant (three equal
coefficients). Everything rests at the outer ends of these cells, so no row there would show the jerk inside the cell.

Source: Nocedal and Wright, "Numerical Optimization", 2nd edition, chapter 19.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from control.retiming.constraints import RowBlock
from control.retiming.initial_guess import InitialGuess

ITERATIONS = 40
GAP = 2e-3  # duality gap relative to the duration that ends the iteration
FRACTION_TO_BOUNDARY = 0.97  # share of the way to the nearest limit that a step goes at most
FIRST_BARRIER = 0.1  # mu of the start in durations per cell
BARRIER_FACTOR = 0.15  # factor by which mu falls after a good step
GOOD_STEP, FAIR_STEP = 0.6, 0.2
SHRINK, SHRINKS = 0.6, 12  # of a step that would leave the limits
LEAST_SLACK = 0.02  # share of a slack that one step must leave
SUBCELLS = 8  # parts of a cell between which p(t) is a polynomial of fifth degree
_GAUSS = np.polynomial.legendre.leggauss(3)


def peak_utilisation(blocks: Sequence[RowBlock], beta: np.ndarray) -> float:
    """Largest squared length of any group, at a constant parameter speed in the end cells; below 1 all limits hold."""
    beta = _even_ends(beta)
    return max(float(block.used(beta).max()) for block in blocks)


def minimise_duration(
    blocks: Sequence[RowBlock],
    cell: float,
    beta: np.ndarray,
    gap_tolerance: float = GAP,
    barrier: float = FIRST_BARRIER,
) -> np.ndarray:
    """Coefficients beta of the shortest duration.

    Args:
        blocks: What has to be kept.
        cell: Length of a cell in [s].
        beta: Coefficients to start from, positive and strictly within all limits, also with a constant parameter speed
            in the first and in the last cell, shape (n + 2,).
        gap_tolerance: Duality gap relative to the duration that is good enough.
        barrier: mu to start with in durations per cell; smaller where beta is near the optimum already.

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
    mu = barrier * shortest / len(beta)
    multipliers = [mu / x.slack for x in state]
    for _ in range(ITERATIONS):
        matrix, gradient = np.zeros((3, len(beta))), -0.5 * weight * beta**-1.5
        matrix[2] = -1.5 * gradient / beta
        pushes = [x.add_to(matrix, gradient, y, mu) for x, y in zip(state, multipliers, strict=True)]
        step = _solve_tied(matrix, -gradient)
        if step is None:  # rounding errors end the iteration
            break
        primal, dual = min(1.0, 0.9 / max(float(np.max(-step / beta)), 1e-12)), 1.0
        changes = []
        for x, y, push in zip(state, multipliers, pushes, strict=True):
            towards = x.towards(step, push)
            change = (mu + y * towards) / x.slack - y
            changes.append(change)
            primal = min(primal, FRACTION_TO_BOUNDARY / max(float(np.max(towards / x.slack)), 1e-12))
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
        if gap < gap_tolerance * now and primal > 0.5:
            break
        centred, reach = gap / count, min(primal, dual)
        if reach > FAIR_STEP:
            factor = BARRIER_FACTOR if reach > GOOD_STEP else 0.5
            mu = min(mu, max(factor * centred, 0.3 * gap_tolerance * now / count))
        else:
            mu = centred
    return best


def _even_ends(beta: np.ndarray) -> np.ndarray:
    """The same with a constant parameter speed in the first and in the last cell."""
    beta = beta.copy()
    beta[:3], beta[-3:] = beta[:3].min(), beta[-3:].min()
    return beta


def _solve_tied(matrix: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """Solve a system of five diagonals, upper form, in which the first three unknowns are equal, and the last three.

    Returns:
        The unknowns, or None where the matrix is not positive definite.
    """
    merged = matrix[:, 2:-2].copy()
    merged[2, 0] += matrix[2, 0] + matrix[2, 1] + 2.0 * (matrix[1, 1] + matrix[1, 2] + matrix[0, 2])
    merged[1, 1] += matrix[0, 3]
    merged[2, -1] += matrix[2, -2] + matrix[2, -1] + 2.0 * (matrix[1, -2] + matrix[1, -1] + matrix[0, -1])
    merged[1, -1] += matrix[0, -2]
    summed = np.concatenate([[right[:3].sum()], right[3:-3], [right[-3:].sum()]])
    _, step, failed = lapack.dpbsv(merged, summed)  # pyright: ignore[reportAttributeAccessIssue]
    if failed:
        return None
    return np.concatenate([[step[0]] * 2, step, [step[-1]] * 2])


@dataclass(frozen=True)
class _Push:
    """How the slacks of one block fall with the values u of the spline: v = lever * direction for scalar groups.

    Attributes:
        lever: Shape (scalars, n).
        directions: dw / du less the factor sqrt(b), k arrays of shape (r, n).
        vectors: v of the groups that are vectors, k arrays of shape (groups - scalars, n).
    """

    lever: NDArray[np.float64]
    directions: tuple[np.ndarray, ...]
    vectors: list[np.ndarray]


@dataclass(frozen=True)
class _State:
    """Rows of one block at one point of the iteration.

    Attributes:
        block: Which.
        u: Values of the spline, shape (k, n).
        linear: Rows without the factor sqrt(b), shape (r, n).
        squares: Squared lengths of the groups, tightened, shape (groups, n).
        slack: Of the groups, shape (groups, n).
    """

    block: RowBlock
    u: NDArray[np.float64]
    linear: NDArray[np.float64]
    squares: NDArray[np.float64]
    slack: NDArray[np.float64]

    @classmethod
    def of(cls, block: RowBlock, beta: np.ndarray) -> "_State":
        u = block.values(beta)
        linear = block.linear(u)
        squares = block.squares(linear, u)
        return cls(block, u, linear, squares, 0.5 - 0.5 * squares)

    def add_to(self, matrix: np.ndarray, gradient: np.ndarray, multiplier: np.ndarray, mu: float) -> _Push:
        """Add this block's part to the banded matrix and the gradient; returns v by value of the spline.

        A scalar's J^T J and v v^T are multiples of the same product, so they are added as one.
        """
        block, n, scalars = self.block, self.slack.shape[1], self.block.scalars
        directions = block.coefficients
        tight = block.tight * self.u[0] if block.rate else block.tight
        if block.rate:
            directions = (directions[0] + self.linear * (0.5 / self.u[0]), *directions[1:])
        pull, barrier = multiplier / self.slack, mu / self.slack
        straight = multiplier * tight
        lever = tight[:scalars] * self.linear[:scalars]
        weight = straight[:scalars] + pull[:scalars] * lever**2
        slant = barrier[:scalars] * lever
        vectors = []
        if scalars < len(self.slack):
            vectors = [tight[scalars:] * _dots(self.linear[scalars:], d[scalars:]) for d in directions]
        pulled = [pull[scalars:] * vector for vector in vectors]
        k = len(directions)
        products, slope = np.empty((k * (k + 1) // 2, n)), np.empty((k, n))
        row = 0
        for i, direction in enumerate(directions):
            slope[i] = np.einsum("rn,rn->n", slant, direction[:scalars])
            weighted = weight * direction[:scalars]
            if vectors:
                slope[i] += np.einsum("gn,gn->n", barrier[scalars:], vectors[i])
            for j in range(i, k):
                products[row] = np.einsum("rn,rn->n", weighted, directions[j][:scalars])
                if vectors:
                    dots = _dots(direction[scalars:], directions[j][scalars:])
                    products[row] += np.einsum("gn,gn->n", straight[scalars:], dots)
                    products[row] += np.einsum("gn,gn->n", pulled[i], vectors[j])
                row += 1
        ends, _, width = block.stencil.shape
        places = block.places
        spread = block.spreading @ products.reshape(-1, places)
        falls = np.einsum("ekj,ken->jn", block.stencil, slope.reshape(k, ends, places))
        row = 0
        for a in range(width):
            gradient[a : a + places] += falls[a]
            for b in range(a, width):
                matrix[2 - (b - a), b : b + places] += spread[row]
                row += 1
        return _Push(lever, directions, vectors)

    def towards(self, step: np.ndarray, push: _Push) -> np.ndarray:
        """By how much a step of the coefficients takes slack away, to first order."""
        change = self.block.values(step)
        scalars = len(push.lever)
        total = push.directions[0][:scalars] * change[0]
        for direction, x in zip(push.directions[1:], change[1:], strict=True):
            total += direction[:scalars] * x
        total *= push.lever
        if not push.vectors:
            return total
        return np.concatenate([total, sum(v * x for v, x in zip(push.vectors, change, strict=True))])


def _dots(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Products of vectors of three, (3 g, n) each, shape (g, n)."""
    return (left * right).reshape(-1, 3, left.shape[1]).sum(axis=1)


@dataclass(frozen=True)
class PathTiming:
    """An initial guess with the parameter speed of the result: a timing from rest to rest.

    Attributes:
        start: The initial guess.
        beta: Coefficients of b = p'^2, a quadratic spline on its cells, positive, shape (n + 2,).
    """

    start: InitialGuess
    beta: NDArray[np.float64]

    @cached_property
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
        """B at shares y of each cell, shape (n, k)."""
        before, here, after = self.beta[:-2, None], self.beta[1:-1, None], self.beta[2:, None]
        return 0.5 * (before * (1.0 - y) ** 2 + here * (1.0 + 2.0 * y - 2.0 * y**2) + after * y**2)

    @property
    def duration(self) -> float:
        """From rest to rest in [s]."""
        return float(self.passed[0][-1])

    def parameter(self, t: np.ndarray) -> np.ndarray:
        """P at times in [s], shape (k,), by polynomials that agree with p, p' and p'' at both ends of each part."""
        times, p, speed, bend = self.passed
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
