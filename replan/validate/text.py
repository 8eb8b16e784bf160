"""A judged motion in words and as JSON: one row for each check, the success rate, the verdict."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from control.safety.certificate import CheckResult
from control.safety.table import SafetyRow, safety_table
from replan.run.episode import plain
from replan.validate.motion import Validation
from sim_check.verdict.verdict import SUCCESS_SHARE

NOT_LOOKED = "not judged: no camera has looked into the space that the motion sweeps"


@dataclass(frozen=True)
class CheckRow:
    """One check as a person reads it.

    Attributes:
        name, meaning, unit: As in the safety table.
        worst, limit: As text.
        least: Whether the value must not fall below the limit.
        share: Worst value in percent of the limit, or None where that says nothing.
        at: Time of the worst moment, or empty.
        bodies: Who takes part.
        ok: Whether it is kept.
        failures: In how many perturbed twins it was broken, or "" where it is not judged there.
        result: The result itself.
    """

    name: str
    meaning: str
    unit: str
    worst: str
    limit: str
    least: bool
    share: int | None
    at: str
    bodies: str
    ok: bool
    failures: str
    result: CheckResult


def check_rows(validation: Validation) -> list[CheckRow]:
    """Every check, broken ones first, each group in the order of the safety table."""
    table = {row.name: row for row in safety_table(validation.safety, validation.limits)}
    broken_in = validation.judgement.failures
    rows = [
        _row(c, table.get(c.name), broken_in.get(c.name), _as_distance(c, validation))
        for c in validation.verdict.checks
    ]
    return sorted(rows, key=lambda row: row.ok)


def _as_distance(check: CheckResult, validation: Validation) -> CheckResult | None:
    """A clearance as people read it: the least distance, which must not fall below what is asked for.

    The check itself holds what lacks of it. Where nothing came near enough to be measured, the distance is infinite.
    """
    part = check.name.removesuffix("_clearance")
    motion = validation.judgement.motion
    if part == check.name or motion is None or motion.clearances is None or part not in motion.clearances.distance:
        return None
    c = motion.clearances
    asked = float(getattr(validation.safety, check.name))
    if not len(c.step) or not np.any(np.isfinite(c.distance[part])):
        return replace(check, worst=math.inf, limit=asked, at=None, bodies=())
    # By what is asked for: a carried thing that is still on its table lacks nothing, though it is not far from it.
    k = int(np.argmax(c.lack[part]))
    at = float(motion.time[c.step[k]])
    return replace(check, worst=asked - float(c.lack[part][k]), limit=asked, at=at, bodies=(c.bodies[part][k],))


def _row(check: CheckResult, row: SafetyRow | None, failures: int | None, nearest: CheckResult | None) -> CheckRow:
    shown = nearest or check
    least = nearest is not None or (row is not None and row.least)
    meaning = row.meaning if row else ""
    if nearest is not None:
        meaning = meaning.replace("distance lacking", "least distance").partition(";")[0]
    share = None
    if shown.limit > 0 and shown.worst >= 0 and not least:
        share = round(100 * shown.worst / shown.limit)
    # Lengths here are clearances and displacements: millimetres are what people think in.
    unit, factor = ("mm", 1e3) if shown.unit == "m" else (shown.unit, 1.0)
    return CheckRow(
        name=shown.name,
        meaning=meaning,
        unit=unit,
        worst=_number(factor * shown.worst, factor * shown.limit, least),
        limit=f"{factor * shown.limit:.5g}",
        least=least,
        share=share,
        at="" if shown.at is None else f"{shown.at:.3f} s",
        bodies=", ".join(dict.fromkeys(shown.bodies)),
        ok=check.ok,
        failures="" if failures is None else str(failures),
        result=check,
    )


def _number(value: float, limit: float, least: bool) -> str:
    """A value with three digits, or as many as it takes to tell it from its limit."""
    if math.isinf(value):
        return "nothing near" if least else "infinite"
    # What is nothing beside its limit is rounding, not a figure.
    if abs(value) < 1e-4 * abs(limit):
        return "0"
    digits = next((d for d in range(3, 9) if value == limit or float(f"{value:.{d}g}") != float(f"{limit:.{d}g}")), 9)
    text = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e+" in text else text


def trials_text(validation: Validation) -> str:
    """The success rate over the perturbed twins, with its interval."""
    v = validation.verdict
    asked = validation.options.perturbed
    if asked == 0:
        return "none were tried"
    low, high = (round(100 * x) for x in v.interval)
    text = f"{v.successes} of {asked} keep everything (95 % interval {low} to {high} %)"
    if v.trials < asked:
        text += f"; {asked - v.trials} could not be drawn and count against it"
    return text


def summary(validation: Validation) -> str:
    """Why it passed or did not, in one line."""
    v = validation.verdict
    failed = v.failed_checks
    if v.passed:
        return f"every check is kept, and {trials_text(validation)}"
    if failed:
        names = ", ".join(c.name for c in failed)
        return f"{len(failed)} of {len(v.checks)} checks are broken: {names}"
    return (
        f"every check is kept in the twin as believed, but of the perturbed twins only {trials_text(validation)}; "
        f"{SUCCESS_SHARE:.0%} are asked for"
    )


def hints(validation: Validation) -> list[str]:
    """What may have been left unsaid, where a check is broken because of it."""
    out = []
    touched = {
        name
        for c in validation.verdict.failed_checks
        if c.name in ("unwanted_contact", "finger_clearance", "moved")
        for name in c.bodies
        if (thing := validation.twin.get(name)) is not None and thing.movable
    }
    grips = bool(validation.trajectory.gripper)
    for name in sorted(touched):
        flag = "--handles" if grips and not validation.options.handles else "--touches"
        out.append(f"hint: if the motion is meant to handle '{name}', say {flag} {name}")
    return out


def as_text(validation: Validation, files: dict[str, str]) -> str:
    """For a terminal: the verdict, a line for each check, the success rate, what was written."""
    v = validation.verdict
    rows = check_rows(validation)
    width = max(len(r.name) for r in rows)
    lines = [f"{'passed' if v.passed else 'REFUSED'}: {summary(validation)}", ""]
    for r in rows:
        sign = ">=" if r.least else "<="
        where = "  ".join(part for part in (f"at {r.at}" if r.at else "", r.bodies) if part)
        twins = f"  [broken in {r.failures} twin{'s' * (r.failures != '1')}]" if r.failures not in ("", "0") else ""
        mark = "ok    " if r.ok else "BROKEN"
        lines.append(
            f"  {mark}  {r.name:{width}}  {r.worst:>12} {sign} {r.limit:<8} {r.unit:<8} {where}{twins}".rstrip()
        )
    lines += ["", f"unseen space: {NOT_LOOKED}"] if validation.judgement.unseen is None else []
    lines += ["", f"perturbed twins: {trials_text(validation)}", *hints(validation)]
    lines += [f"{what}: {path}" for what, path in files.items()]
    return "\n".join(lines)


def as_json(validation: Validation, files: dict[str, str], seconds: float) -> dict[str, Any]:
    """Everything as one JSON object; units stand beside the numbers."""
    v, t = validation.verdict, validation.trajectory
    return {
        "file": str(validation.options.file),
        "source": validation.motion.source,
        "cell": validation.cell.name,
        "profile": validation.limits.profile,
        "scene": {
            "source": validation.scene.source,
            "stamp": validation.scene.stamp,
            "objects": validation.scene.names,
        },
        "duration_s": t.duration,
        "samples": len(t.q),
        "trajectory_hash": t.content_hash(),
        "retimed": plain(validation.retiming),
        "passed": v.passed,
        "summary": summary(validation),
        "checks": [
            {**plain(r.result), "least": r.least, "meaning": r.meaning, "broken_in_twins": r.failures or None}
            for r in check_rows(validation)
        ],
        "unseen": NOT_LOOKED if validation.judgement.unseen is None else plain(validation.judgement.unseen.record),
        "successes": v.successes,
        "trials": v.trials,
        "hints": hints(validation),
        "asked_trials": validation.options.perturbed,
        "interval": list(v.interval),
        "success_share_needed": SUCCESS_SHARE,
        "steps": v.steps,
        "seconds": seconds,
        **files,
    }
