"""Results for people at a terminal, beside the paper's numbers."""

from collections.abc import Sequence

from replan.rc.paper import published, published_average
from replan.rc.results import TaskResult, VariantResult
from replan.rc.tasks import TASKS

HEAD = ("task", "success", "95 %", "paper", "claimed", "actions", "s", "planner s/step", "tokens", "cost", "causes")
LINE = "{:18} {:>9} {:>9} {:>6} {:>8} {:>9} {:>7} {:>15} {:>8} {:>7}  {}"


def results_text(results: Sequence[VariantResult]) -> str:
    """One table a variant."""
    return "\n\n".join("\n".join(_lines(result)) for result in results)


def _lines(result: VariantResult) -> list[str]:
    made_with = "; ".join(x for x in (result.reasoner, result.perception, f"commit {result.commit}") if x)
    lines = [f"{result.variant} ({made_with})", LINE.format(*HEAD)]
    lines += [_line(name, task, published(result.variant, name)) for name, task in result.tasks.items()]
    paper = published_average(result.variant, result.tasks)
    some = "" if len(result.tasks) == len(TASKS) else f" of {len(result.tasks)} tasks"
    average = f"{100 * result.average:.1f} %"
    lines.append(f"{'average' + some:18} {average:>9} {'':>9} {'' if paper is None else f'{paper:.4g}':>6}")
    return lines


def _line(name: str, task: TaskResult, paper: int | None) -> str:
    return LINE.format(
        TASKS[name].title,
        f"{task.success}/{task.runs}",
        interval_text(task),
        "" if paper is None else paper,
        task.claimed,
        f"{task.actions_mean:.1f}/{task.actions_max}",
        f"{task.wall_s_median:.1f}",
        "" if task.planner_s_per_step_median is None else f"{task.planner_s_per_step_median:.3f}",
        f"{task.tokens_mean:.0f}" if task.tokens_mean else "",
        f"{task.cost_mean:.4f}" if task.cost_mean else "",
        causes_text(task),
    ).rstrip()


def interval_text(task: TaskResult) -> str:
    """The success rate's interval in percent."""
    low, high = task.success_interval
    return f"{100 * low:.0f}..{100 * high:.0f}"


def causes_text(task: TaskResult) -> str:
    """Causes with their counts."""
    return ", ".join(f"{cause} {count}" for cause, count in task.causes.items())
