"""A judged motion in words and as JSON: one row for each check, the success rate, the verdict."""

from dataclasses import dataclass
from typing import Any

from control.certificate import CheckResult
from control.safety_table import SafetyRow, safety_table
from replan.episode import plain
from replan.validate import Validation


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
    rows = [_row(c, table.get(c.name), broken_in.get(c.name)) for c in validation.verdict.checks]
    return sorted(rows, key=lambda row: row.ok)


def _row(check: CheckResult, row: SafetyRow | None, failures: int | None) -> CheckRow:
    least = row is not None and row.least
    share = None
    if check.limit > 0 and check.worst >= 0 and not least:
        share = round(100 * check.worst / check.limit)
    return CheckRow(
        name=check.name,
        meaning=row.meaning if row else "",
        unit=check.unit,
        worst=f"{check.worst:.4g}",
        limit=f"{check.limit:.4g}",
        least=least,
        share=share,
        at="" if check.at is None else f"{check.at:.3f} s",
        bodies=", ".join(dict.fromkeys(check.bodies)),
        ok=check.ok,
        failures="" if failures is None else str(failures),
        result=check,
    )


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
    need = validation.options.success_share
    return f"every check is kept in the twin as believed, but of the perturbed twins only {trials_text(validation)}; {need:.0%} are asked for"


def as_text(validation: Validation, files: dict[str, str]) -> str:
    """For a terminal: the verdict, a line for each check, the success rate, what was written."""
    v = validation.verdict
    rows = check_rows(validation)
    width = max(len(r.name) for r in rows)
    lines = [f"{'passed' if v.passed else 'REFUSED'}: {summary(validation)}", ""]
    for r in rows:
        sign = ">=" if r.least else "<="
        value = f"{r.worst} {r.unit}"
        where = "  ".join(part for part in (f"at {r.at}" if r.at else "", r.bodies) if part)
        twins = f"  [broken in {r.failures} twins]" if r.failures not in ("", "0") else ""
        lines.append(
            f"{'  ok   ' if r.ok else '  BREAKS'[:7]} {r.name:{width}}  {value:>28} {sign} {r.limit:<8} {where}{twins}".rstrip()
        )
    lines += ["", f"perturbed twins: {trials_text(validation)}"]
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
        "scene": {"source": validation.scene.source, "stamp": validation.scene.stamp, "objects": validation.scene.names},
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
        "successes": v.successes,
        "trials": v.trials,
        "asked_trials": validation.options.perturbed,
        "interval": list(v.interval),
        "success_share_needed": validation.options.success_share,
        "steps": v.steps,
        "seconds": seconds,
        **files,
    }
