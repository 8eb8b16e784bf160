"""Plots of a judged motion as SVG text: joints against their limits, the hand's speed, clearances over time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.robot.limits import RobotLimits
from control.safety.limits import SafetyLimits
from control.safety.residuals import Clearances
from control.safety.trajectory_checks import PADDING, Torque, commanded_differences
from control.trajectory.samples import SAMPLE_TIME, Trajectory
from replan.reports.svg_figures import ALLOWED, BROKEN, INK, QUIET, figure_of, svg_text

COLUMNS = 600  # of a drawn curve; each shows the least and the largest sample of its stretch, so no peak is lost
PART_COLOURS = {"self": "#6a51a3", "arm": "#1f4e79", "finger": "#2e7d32", "held": "#d08700"}
PART_NAMES = {"self": "robot to itself", "arm": "arm and hand", "finger": "fingers", "held": "carried object"}
FARTHEST = 0.05  # [m] of a clearance that is drawn: beyond, nothing is near


@dataclass(frozen=True)
class Quantity:
    """One quantity of all joints over time, against its limits.

    Attributes:
        name: For people.
        unit: Of the values.
        values: Every millisecond, shape (n, 7).
        low, high: Published limits, shape (7,).
        share: Share of them that is allowed, 0..1, shape (7,); of positions counted from the middle of the range.
    """

    name: str
    unit: str
    values: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    share: NDArray[np.float64]


def joint_quantities(
    trajectory: Trajectory, limits: RobotLimits, safety: SafetyLimits, torque: Torque
) -> tuple[Quantity, ...]:
    """Position, velocity, acceleration, jerk, torque and torque rate of every sample by backward differences.

    Args:
        trajectory: 1 kHz samples.
        limits: Published limits.
        safety: Shares of them that may be used.
        torque: (q, qd, qdd), each (n, 7), to joint torques in [Nm], for the samples with `PADDING` rows of rest
            on either side.
    """
    q, qd, qdd, jerk = commanded_differences(trajectory.q)
    tau = torque(q, qd, qdd)
    rate = np.diff(tau, axis=0, prepend=tau[:1]) / SAMPLE_TIME
    margin = 1.0 - 2.0 * safety.joint_margin / (limits.q_max - limits.q_min)
    whole = np.ones(len(limits.qd))
    rows = (
        ("position", "rad", q, limits.q_min, limits.q_max, margin),
        ("velocity", "rad/s", qd, -limits.qd, limits.qd, safety.velocity_scale * whole),
        ("acceleration", "rad/s²", qdd, -limits.qdd, limits.qdd, safety.acceleration_scale * whole),
        ("jerk", "rad/s³", jerk, -limits.qddd, limits.qddd, whole),
        ("torque", "Nm", tau, -limits.tau, limits.tau, whole),
        ("torque rate", "Nm/s", rate, -limits.taud, limits.taud, whole),
    )
    return tuple(Quantity(n, u, v[PADDING:], low, high, share) for n, u, v, low, high, share in rows)


def joints_svg(
    quantities: Sequence[Quantity], joint_names: Sequence[str], stretches: Sequence[tuple[str, float]]
) -> str:
    """Small multiples: a row for each quantity, a column for each joint; full height is the published limit.

    Args:
        quantities: What to draw.
        joint_names: Names of the columns.
        stretches: Named stretches of the motion and the times in [s] at which they end, drawn as fine lines.
    """
    figure, axes = figure_of(len(quantities), len(joint_names), (15.5, 1.55 * len(quantities) + 0.5), top=0.5)
    for i, quantity in enumerate(quantities):
        middle, half = (quantity.low + quantity.high) / 2, (quantity.high - quantity.low) / 2
        for j, name in enumerate(joint_names):
            ax = axes[i][j]
            share = (quantity.values[:, j] - middle[j]) / half[j]
            worst = int(np.argmax(np.abs(share)))
            colour = BROKEN if abs(share[worst]) > quantity.share[j] + 1e-6 else INK
            for sign in (-1, 1):
                ax.axhline(sign, color=QUIET, linewidth=0.8)
                if quantity.share[j] < 0.999:
                    ax.axhline(sign * quantity.share[j], color=ALLOWED, linewidth=0.7, linestyle=(0, (4, 3)))
            times, low, high = _envelope(share)
            ax.fill_between(times, low, high, color=colour, linewidth=0.9)
            for _, end in stretches[:-1]:
                ax.axvline(end, color=QUIET, linewidth=0.4, alpha=0.6)
            top = max(1.12, 1.08 * float(np.abs(share).max()))
            ax.set_ylim(-top, top)
            ax.set_xlim(0, times[-1])
            value = quantity.values[worst, j]
            number = f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
            ax.set_title(f"{number} {quantity.unit} · {100 * abs(share[worst]):.0f} %", color=colour, pad=2)
            ax.set_yticks([-1, 0, 1], ["−100 %", "0", "100 %"] if j == 0 else ["", "", ""])
            if i == 0:
                ax.annotate(name, (0.5, 1.22), xycoords="axes fraction", ha="center", fontsize=9, fontweight="bold")
            if j == 0:
                ax.set_ylabel(quantity.name)
            if i == len(quantities) - 1:
                ax.set_xlabel("s", labelpad=1)
            else:
                ax.set_xticklabels([])
    return svg_text(figure)


def hand_svg(speed: np.ndarray, turning: np.ndarray, safety: SafetyLimits) -> str:
    """Speed of the tool centre point in [m/s] and of its rotation in [rad/s], shape (n,) each, against the limits."""
    figure, axes = figure_of(1, 2, (15.5, 2.1), wide=0.1)
    for ax, values, limit, unit in (
        (axes[0][0], speed, safety.hand_speed, "m/s"),
        (axes[0][1], turning, safety.hand_angular_speed, "rad/s"),
    ):
        broken = float(values.max(initial=0.0)) > limit + 1e-6
        times, low, high = _envelope(values)
        ax.fill_between(times, low, high, color=BROKEN if broken else INK, linewidth=0.9)
        ax.axhline(limit, color=ALLOWED, linewidth=1.0, linestyle=(0, (4, 3)))
        ax.set_xlim(0, times[-1])
        ax.set_ylim(0, max(1.12 * limit, 1.05 * float(values.max(initial=0.0))))
        ax.set_ylabel(unit)
        ax.set_xlabel("s", labelpad=1)
    axes[0][0].set_title("commanded speed of the tool centre point, and its limit", loc="left")
    axes[0][1].set_title("commanded speed of its rotation, and its limit", loc="left")
    return svg_text(figure)


def clearance_svg(clearances: Clearances, times: np.ndarray, safety: SafetyLimits) -> str:
    """Least distance of each part to what it may not touch over time, on top of the clearance that is asked for.

    Args:
        clearances: Of the nominal twin.
        times: Times of the recorded motion's samples in [s], to which they refer.
        safety: The clearances that are asked for.
    """
    figure, axes = figure_of(1, 1, (15.5, 3.0))
    ax = axes[0][0]
    at = times[clearances.step]
    lowest = 0.0
    for part, colour in PART_COLOURS.items():
        asked = float(getattr(safety, f"{part}_clearance"))
        distance = clearances.distance[part]
        near = np.where(distance < FARTHEST, distance, np.nan)
        if np.all(np.isnan(near)):
            continue
        lowest = min(lowest, float(np.nanmin(near)))
        ax.plot(at, 1e3 * near, color=colour, linewidth=1.4, label=PART_NAMES[part])
        ax.axhline(1e3 * asked, color=colour, linewidth=0.8, linestyle=(0, (4, 3)))
        below = clearances.lack[part] > 0.0
        if np.any(below):
            ax.plot(at[below], 1e3 * distance[below], ".", color=BROKEN, markersize=4)
    ax.axhline(0.0, color=QUIET, linewidth=0.8)
    ax.set_ylim(1e3 * min(lowest * 1.1, -0.002), 1e3 * FARTHEST)
    ax.set_xlim(0, float(times[-1]))
    ax.set_ylabel("mm")
    ax.set_xlabel("s", labelpad=1)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper right", ncols=4, frameon=False, fontsize=8)
    ax.set_title("distance to what may not be touched (dashed: what is asked for; red: less than that)", loc="left")
    return svg_text(figure)


def _envelope(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times in [s], least and largest value of each drawn column; neighbours overlap by a sample, so lines join."""
    n = len(values)
    edges = np.unique(np.linspace(0, n - 1, min(COLUMNS, n)).astype(int))
    if len(edges) == n:
        return edges * SAMPLE_TIME, values, values
    starts, stops = edges[:-1], edges[1:] + 1
    low = np.array([values[a:b].min() for a, b in zip(starts, stops, strict=True)])
    high = np.array([values[a:b].max() for a, b in zip(starts, stops, strict=True)])
    times = (starts + stops - 1) / 2 * SAMPLE_TIME
    times[0], times[-1] = 0.0, (n - 1) * SAMPLE_TIME
    return times, low, high
