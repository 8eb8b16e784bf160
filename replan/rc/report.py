"""The benchmark's page: rates beside the paper's, where the seconds went, and every episode with its pictures.

It needs no network: figures stand in the page, thumbnails in the folder `thumbnails` beside it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from replan.rc.paper import published, published_average
from replan.rc.records import EpisodeRecord
from replan.rc.report_figures import rates_svg, seconds_svg
from replan.rc.results import TaskResult, VariantResult
from replan.rc.tasks import TASKS
from replan.rc.text import causes_text, interval_text
from replan.reports.pages import made_by, write_page

THUMBNAIL = 880  # [px] wide
QUALITY = 65  # of JPEG


def write_report(folder: Path, records: Sequence[EpisodeRecord], results: Sequence[VariantResult]) -> Path:
    """Write report.html.

    Args:
        folder: The benchmark's folder.
        records: Its episodes.
        results: The same, counted.

    Returns:
        The page.

    Raises:
        ConfigError: It cannot be written.
    """
    setup = records[0].setup
    content: dict[str, Any] = {
        "episodes": len(records),
        "succeeded": sum(r.success for r in records),
        "claimed_wrongly": sum(r.claimed and not r.success for r in records),
        "setup": [(k, _setting(v)) for k, v in setup.items()],
        "variants": [_variant(result) for result in results],
        "rates": rates_svg(results),
        "groups": [
            {"title": TASKS[task].title, "goal": TASKS[task].goal, "cards": [_card(folder, r) for r in mine]}
            for task in TASKS
            if (mine := [r for r in records if r.job["task"] == task])
        ],
        "footer": made_by(),
    }
    page = folder / "report.html"
    write_page("rc.html.j2", content, page)
    return page


def _variant(result: VariantResult) -> dict[str, Any]:
    timed = any(task.seconds_by_part for task in result.tasks.values())
    return {
        "name": result.variant,
        "reasoner": result.reasoner or "unknown: no episode came to its end",
        "perception": result.perception or "unknown: no episode came to its end",
        "commit": result.commit or "unknown",
        "average": f"{100 * result.average:.1f} %",
        "paper_average": _percent(published_average(result.variant, result.tasks)),
        "rows": [_row(result.variant, name, task) for name, task in result.tasks.items()],
        "seconds": seconds_svg(result) if timed else "",
    }


def _row(variant: str, name: str, task: TaskResult) -> dict[str, Any]:
    per_step = task.planner_s_per_step_median
    return {
        "title": TASKS[name].title,
        "success": f"{task.success}/{task.runs}",
        "rate": f"{100 * task.rate:.0f} %",
        "width": round(100 * task.rate),
        "interval": f"{interval_text(task)} %",
        "paper": _percent(published(variant, name)),
        "claimed": task.claimed,
        "actions": f"{task.actions_mean:.1f} / {task.actions_max}",
        "replans": f"{task.replans_mean:.1f}",
        "seconds": f"{task.wall_s_median:.1f}",
        "planner": "" if per_step is None else f"{per_step:.3f}",
        "questions": f"{task.questions_mean:.0f}",
        "tokens": f"{task.tokens_mean:.0f}" if task.tokens_mean else "",
        "cost": f"{task.cost_mean:.4f}" if task.cost_mean else "",
        "causes": causes_text(task),
    }


def _setting(value: Any) -> str:
    """A setting for people; of options with many fields only those that are not the default ones are recorded."""
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {v}" for k, v in value.items()) or "default"
    return str(value)


def _percent(value: float | None) -> str:
    return "" if value is None else f"{value:.4g} %"


def _card(folder: Path, record: EpisodeRecord) -> dict[str, Any]:
    return {
        "variant": record.job["variant"]["name"],
        "seed": record.job["seed"],
        "success": record.success,
        "cause": record.cause,
        "why": record.why,
        "reason": record.reason,
        "claimed": record.claimed,
        "seconds": f"{record.seconds or record.wall_s:.1f}",
        "plans": [list(plan) for plan in record.plans],
        "actions": [a.model_dump() for a in record.actions],
        "folder": record.folder if record.folder and (folder / record.folder).is_dir() else "",
        "thumbnail": _thumbnail(folder, record),
    }


def _thumbnail(folder: Path, record: EpisodeRecord) -> str:
    """The run's strip of pictures made small, relative to the page; "" where there is none."""
    import cv2

    strip = folder / record.folder / "strip.png"
    if not record.folder or not strip.is_file():
        return ""
    job = record.job
    small = folder / "thumbnails" / f"{job['variant']['name']}_{job['task']}_{job['seed']:04d}.jpg"
    if not small.exists() or small.stat().st_mtime < strip.stat().st_mtime:
        picture = cv2.imread(str(strip))
        if picture is None:
            return ""
        height = round(picture.shape[0] * THUMBNAIL / picture.shape[1])
        small.parent.mkdir(exist_ok=True)
        resized = cv2.resize(picture, (THUMBNAIL, height), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(small), resized, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return small.relative_to(folder).as_posix()
