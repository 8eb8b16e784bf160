"""Where the things of a recording were over time, and when they were seen, as SVG text."""

from collections.abc import Mapping, Sequence

import numpy as np

from perception.pictures import PALETTE
from replan.perceive.tally import Spot
from replan.reports.svg_figures import QUIET, figure_of, svg_text

DRAWN = 400  # most points of one thing that are drawn
NARROWEST = 0.02  # [m] that an axis spans at least, so that a thing that stands still looks still


def timeline_svg(spots: Mapping[str, Sequence[Spot]], times: Sequence[float]) -> str:
    """Small multiples over time: when each thing was seen, and its x, y, z (dots: one frame; line: filtered).

    Args:
        spots: By thing, in order of time.
        times: Stamps of all frames in [s].
    """
    start = min(times)
    last = max(max(times) - start, 1e-3)
    names = list(spots)
    figure, axes = figure_of(1, 4, (15.5, max(2.6, 1.0 + 0.22 * len(names))), wide=0.2)
    for i, name in enumerate(names):
        colour = "#{:02x}{:02x}{:02x}".format(*PALETTE[i % len(PALETTE)])
        thinned = spots[name][:: -(-len(spots[name]) // DRAWN)]
        at = np.array([s.time - start for s in thinned])
        axes[0][0].plot(at, np.full(len(at), len(names) - i), "|", color=colour, markersize=9, markeredgewidth=1.6)
        seen, filtered = np.array([s.seen for s in thinned]), np.array([s.filtered for s in thinned])
        for axis in range(3):
            axes[0][axis + 1].plot(at, seen[:, axis], ".", color=colour, markersize=5, alpha=0.45)
            axes[0][axis + 1].plot(at, filtered[:, axis], color=colour, linewidth=1.3)
    strip = axes[0][0]
    strip.set_yticks(range(len(names), 0, -1), names)
    strip.tick_params(axis="y", labelsize=8)
    strip.set_ylim(0.4, len(names) + 0.6)
    strip.set_title("seen in", loc="left")
    for axis, letter in enumerate("xyz"):
        ax = axes[0][axis + 1]
        low, high = ax.get_ylim()
        middle, half = (low + high) / 2, max(high - low, NARROWEST) / 2
        ax.set_ylim(middle - half, middle + half)
        ax.set_title(f"{letter} [m]", loc="left")
        ax.grid(color=QUIET, alpha=0.25, linewidth=0.5)
    for ax in axes.flat:
        ax.set_xlim(-0.02 * last, 1.02 * last)
        ax.set_xlabel("s since the first frame", labelpad=1)
    return svg_text(figure)
