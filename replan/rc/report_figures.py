"""Figures of the benchmark's report, as SVG text."""

from collections.abc import Sequence

import numpy as np

from replan.rc.paper import published
from replan.rc.results import VariantResult
from replan.rc.tasks import TASKS
from replan.reports.svg_figures import ALLOWED, INK, QUIET, figure_of, svg_text
from replan.run.stopwatch import PARTS

COLOURS = ("#5b8db8", INK, "#2e7d5b", "#8fbf9f", "#8a5a9e", "#c39bd3", "#a0522d", "#7f8c8d")
PART_COLOURS = ("#5b8db8", INK, "#2e7d5b", "#8fbf9f", "#c39bd3", "#8a5a9e", "#c8a15a")


def rates_svg(results: Sequence[VariantResult]) -> str:
    """Success rate of every task as bars by variant, with 95 % intervals; diamonds are the paper's numbers."""
    names = [name for name in TASKS if any(name in r.tasks for r in results)]
    figure, axes = figure_of(1, 1, (12.0, 3.4), top=0.5)
    ax = axes[0][0]
    width = 0.8 / len(results)
    compared = False
    for i, result in enumerate(results):
        known = [n for n in names if n in result.tasks]
        at = np.array([names.index(n) for n in known]) + (i - (len(results) - 1) / 2) * width
        rates = np.array([100 * result.tasks[n].rate for n in known])
        low, high = (np.array([100 * result.tasks[n].success_interval[k] for n in known]) for k in (0, 1))
        ax.bar(at, rates, 0.92 * width, color=COLOURS[i % len(COLOURS)], label=result.variant)
        spread = np.abs([rates - low, high - rates])
        ax.errorbar(at, rates, spread, fmt="none", ecolor="#1c2733", elinewidth=0.8, capsize=2)
        paper = [(x, p) for x, n in zip(at, known, strict=True) if (p := published(result.variant, n)) is not None]
        if paper:
            label = None if compared else "paper, other scenes and models"
            ax.plot(*zip(*paper, strict=True), "D", color=ALLOWED, markersize=4.5, markeredgecolor="white", label=label)
            compared = True
    ax.set_xticks(range(len(names)), [TASKS[n].title for n in names])
    ax.tick_params(axis="x", labelsize=8)
    ax.set_xlim(-0.6, len(names) - 0.4)
    ax.set_ylim(0, 104)
    ax.set_ylabel("success [%]")
    ax.grid(axis="y", color=QUIET, alpha=0.25, linewidth=0.5)
    ax.set_axisbelow(True)
    ax.legend(ncols=5, fontsize=7.5, frameon=False, loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0)
    return svg_text(figure)


def seconds_svg(result: VariantResult) -> str:
    """Where the seconds of one variant's runs go: mean by task, one bar a task."""
    names = [name for name, task in result.tasks.items() if task.seconds_by_part]
    figure, axes = figure_of(1, 1, (12.0, 1.1 + 0.28 * max(1, len(names))), top=0.35)
    ax = axes[0][0]
    left = np.zeros(len(names))
    for part, colour in zip(PARTS, PART_COLOURS, strict=True):
        seconds = np.array([result.tasks[n].seconds_by_part[part] for n in names])
        ax.barh(range(len(names)), seconds, 0.7, left=left, color=colour, label=part)
        left += seconds
    ax.set_yticks(range(len(names)), [TASKS[n].title for n in names])
    ax.invert_yaxis()
    ax.set_xlabel("mean wall time of a run [s]", labelpad=1)
    ax.legend(ncols=len(PARTS), fontsize=7.5, frameon=False, loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0)
    place = ax.get_position()
    ax.set_position((0.11, place.y0, place.x1 - 0.11, place.height))  # room for the tasks' titles
    return svg_text(figure)
