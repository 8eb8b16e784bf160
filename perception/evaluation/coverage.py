"""Whether spreads are true: how often errors lie within what estimates claim, and what was refused. Needs numpy only.

A share k of n comes with Wilson's interval at 95 %:

    (p + z^2 / 2n ± z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n),   p = k / n, z = 1.96
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from perception.estimates import ObjectEstimate
from perception.evaluation.metrics import compare, errors_of, median_p95
from perception.ground_truth import TrueObject

QUANTITIES = ("x", "y", "z", "yaw", "width", "height")
HALF_IN_VIEW = 0.5  # share of a thing that shows from which a refusal counts
WHOLE = 0.97  # share from which nothing hides it
BORDER_PX = 2  # a thing nearer to the picture's border than this is cut by it, in [px]


@dataclass(frozen=True)
class Claimed:
    """One thing that truly is there, and what an estimate claims of it.

    Attributes:
        kind: "whole", "hidden in part" or "cut by the picture".
        visible_share: Share of it that shows, 0..1.
        refused: Why there is no estimate, or what is doubted; None for an estimate that is offered.
        position_mm, yaw_deg: Errors; NaN where there is no estimate, or no yaw.
        by_spread: Errors by the spreads claimed, by quantity; level sides share the name "width".
    """

    kind: str
    visible_share: float
    refused: str | None
    position_mm: float = float("nan")
    yaw_deg: float = float("nan")
    by_spread: Mapping[str, Sequence[float]] | None = None


def claimed(estimate: ObjectEstimate | None, truth: TrueObject, reason: str = "not seen") -> Claimed:
    """What an estimate claims of a thing, held against the truth.

    Args:
        estimate: None where there is none.
        truth: What it is an estimate of.
        reason: Why there is none.
    """
    kind = "whole" if truth.visible_share >= WHOLE else "hidden in part"
    if truth.mask is not None and _cut(truth.mask):
        kind = "cut by the picture"
    if estimate is None:
        return Claimed(kind, truth.visible_share, reason)
    error = compare(estimate, truth)
    off, yaw_deg, sides, stds = errors_of(estimate, truth)
    by_spread: dict[str, list[float]] = {
        axis: [float(o / s)] for axis, o, s in zip("xyz", off, estimate.position_std, strict=True)
    }
    if np.isfinite(yaw_deg) and np.isfinite(estimate.yaw_std):
        by_spread["yaw"] = [float(np.radians(yaw_deg) / estimate.yaw_std)]
    if sides is not None and stds is not None:
        ratio = sides / stds
        by_spread |= {"width": [float(ratio[0]), float(ratio[1])], "height": [float(ratio[2])]}
    refused = "; ".join(estimate.doubts) or None
    return Claimed(kind, truth.visible_share, refused, error.position_mm, error.yaw_deg, by_spread)


def coverage(things: Sequence[Claimed]) -> dict[str, Any]:
    """All figures over what was offered, and what was refused; by kind as well."""
    return {
        **_figures(things),
        "by_kind": {kind: _figures([t for t in things if t.kind == kind]) for kind in sorted({t.kind for t in things})},
    }


def coverage_table(figures: Mapping[str, Any]) -> str:
    """The figures of `coverage` as text."""
    header = f"{'':20}{'n':>5}{'refused':>16}{'position mm':>13}{'yaw deg':>11}  " + "".join(
        f"{q:>10}" for q in QUANTITIES
    )
    lines = [header]
    for label, row in {"all": figures, **figures["by_kind"]}.items():
        refused = row["refused"]
        share = "-" if refused["share"] is None else "{:.2f} ({:.2f}-{:.2f})".format(refused["share"], *refused["ci95"])
        cells = []
        for name in QUANTITIES:
            within = row["within"][name]
            cells.append("-" if not within["n"] else f"{100 * within['68']:.0f}/{100 * within['95']:.0f}")
        pairs = [
            "-" if row[key]["median"] is None else f"{row[key]['median']:.1f}/{row[key]['p95']:.1f}"
            for key in ("position_mm", "yaw_deg")
        ]
        lines.append(
            f"{label:20}{row['n']:>5}{share:>16}{pairs[0]:>13}{pairs[1]:>11}  " + "".join(f"{c:>10}" for c in cells)
        )
    lines.append(
        "refused: of things at least half in view; median/p95 and % within the 68 %/95 % interval of the offered"
    )
    return "\n".join(lines)


def share_with_interval(values: Iterable[bool]) -> tuple[float | None, tuple[float, float] | None]:
    """Share of what is true and Wilson's interval at 95 %; None for no value."""
    found = np.array(list(values), bool)
    n = len(found)
    if not n:
        return None, None
    p, z = float(found.mean()), 1.96
    middle, reach = p + z**2 / (2 * n), z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    low, high = (middle - reach) / (1 + z**2 / n), (middle + reach) / (1 + z**2 / n)
    return round(p, 4), (round(float(max(low, 0.0)), 4), round(float(min(high, 1.0)), 4))


def _figures(things: Sequence[Claimed]) -> dict[str, Any]:
    offered = [t for t in things if t.refused is None]
    refused, interval = share_with_interval(t.refused is not None for t in things if t.visible_share >= HALF_IN_VIEW)
    within: dict[str, Any] = {}
    for name in QUANTITIES:
        ratios = np.array([r for t in offered for r in (t.by_spread or {}).get(name, ())])
        one, one_ci = share_with_interval(np.abs(ratios) < 1.0)
        two, two_ci = share_with_interval(np.abs(ratios) < 1.96)
        within[name] = {"n": len(ratios), "68": one, "68_ci95": one_ci, "95": two, "95_ci95": two_ci}
    return {
        "n": len(things),
        "offered": len(offered),
        "refused": {"share": refused, "ci95": interval},
        "position_mm": median_p95(t.position_mm for t in offered),
        "yaw_deg": median_p95(t.yaw_deg for t in offered),
        "within": within,
    }


def _cut(mask: np.ndarray) -> bool:
    inner = mask.copy()
    inner[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX] = False
    return bool(inner.any())
