"""What the paper reports for the same eight tasks: completion rates of 10 runs each, in percent.

Source: M. Skreta, Z. Zhou, J. L. Yuan, K. Darvish, A. Aspuru-Guzik, A. Garg, "RePlan: Robotic Replanning with
Perception and Language Models", completion rates on the Reasoning and Control benchmark. Its scenes, arm and language
models are others than ours; docs/rc-benchmark.md says what may be compared.
"""

import statistics
from collections.abc import Collection, Mapping
from types import MappingProxyType

_COLUMNS = ("full", "no-verifier", "no-perceiver", "no-replan", "language-to-rewards")
_ROWS = {
    "cabinet-open": (100, 80, 90, 80, 90),
    "cabinet-closed": (100, 80, 90, 70, 20),
    "cabinet-blocked": (60, 20, 30, 0, 0),
    "cabinet-locked": (100, 100, 50, 0, 0),
    "cubes-color": (90, 100, 20, 80, 50),
    "cubes-blocked": (90, 80, 0, 10, 10),
    "kitchen-explore": (80, 60, 20, 0, 0),
    "composite-explore": (70, 20, 0, 20, 0),
}
# Of each variant's mean over the tasks. The paper prints 67.05 without verifier; its own rows give 67.5.
AVERAGES: Mapping[str, float] = MappingProxyType(
    {"full": 86.25, "no-verifier": 67.05, "no-perceiver": 37.5, "no-replan": 32.5, "language-to-rewards": 21.25}
)


def published(variant: str, task: str) -> int | None:
    """The paper's completion rate in percent, or None for a variant that it does not report."""
    return _ROWS[task][_COLUMNS.index(variant)] if variant in _COLUMNS else None


def published_average(variant: str, tasks: Collection[str]) -> float | None:
    """The paper's average in percent over these tasks, as it prints it where these are all."""
    if variant not in AVERAGES or set(tasks) == set(_ROWS):
        return AVERAGES.get(variant)
    return statistics.fmean(_ROWS[task][_COLUMNS.index(variant)] for task in tasks)
