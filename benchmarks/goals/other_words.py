"""How far the planner goes beyond the wordings and cells that it was made with: `benchmarks.goals.other_words_goals`.

Each goal is run once, in a simulated cell and a process of its own that is ended after `--limit` seconds, and judged on
the cell's truth. Three stages are told apart: whether the goal was understood, whether a first plan had steps, and
whether the goal was truly reached (or refused, or answered) as it should be.

    python -m benchmarks.goals.other_words
    python -m benchmarks.goals.other_words --set 2
    python -m benchmarks.goals.other_words --goals oven_door curtain --json
    python -m benchmarks.goals.other_words --plan-only

With `--plan-only` nothing moves and nothing is perceived: see `benchmarks.goals.other_words_plans`.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.goals.other_words_goals import GOALS, SETS, Ending, GoalSet, WordGoal, fulfilled
from benchmarks.goals.other_words_plans import plan_one, plan_summary, print_plans
from control.errors import GoalError, StackError
from perception.errors import PerceptionError
from perception.ground_truth import CellTruth
from replan.run.goal import run_goal
from replan.run.options import RunOptions
from replan_base.processes import python_module

LIMIT = 240.0  # [s] for one goal, the start of its simulated cell included


@dataclass(frozen=True)
class Row:
    """What became of one goal.

    Attributes:
        name: Key of `GOALS`.
        parsed: Whether it was understood.
        planned: Whether its first plan had steps.
        done: Whether it ended as it should.
        seconds: Wall time in [s].
        reason: What the run said, after what was wrong about it.
        folder: The run's folder; "" if it made none.
    """

    name: str
    parsed: bool
    planned: bool
    done: bool
    seconds: float
    reason: str
    folder: str

    @property
    def ended_at(self) -> str:
        """Stage at which it went wrong, or "done"."""
        if self.done:
            return "done"
        if not self.parsed:
            return "parsing"
        return "carrying out" if self.planned else "planning"


def run_one(name: str, runs_dir: Path) -> Row:
    """Run one goal in this process.

    Args:
        name: Key of `GOALS`.
        runs_dir: Empty folder that gets the run's folder.
    """
    goal = GOALS[name]
    truth: dict[str, CellTruth] = {}
    started, parsed = time.monotonic(), True
    try:
        report = run_goal(
            _options(goal, runs_dir),
            say=lambda text: print(text, file=sys.stderr),
            on_client=lambda when, client: truth.update({when: client.truth()}),
        )
        claimed, seconds, reason = report.reached, report.seconds, report.reason
    except (StackError, PerceptionError) as error:
        parsed = not isinstance(error, GoalError)
        claimed, seconds, reason = False, time.monotonic() - started, f"{type(error).__name__}: {error}"
    done, wrong = fulfilled(goal, Ending(claimed, reason, truth.get("before"), truth.get("after")))
    folder, planned = _record(runs_dir)
    return Row(name, parsed, planned, done, round(seconds, 1), f"{wrong}; {reason}" if wrong else reason, folder)


def _options(goal: WordGoal, runs_dir: Path) -> RunOptions:
    return RunOptions(
        goal.goal,
        cell=str(goal.cell_file),
        cell_options=goal.options,
        seed=goal.seed,
        speed=0.0,
        runs_dir=runs_dir,
        video=False,
        strip=False,
        score=True,
    )


def _record(runs_dir: Path) -> tuple[str, bool]:
    """The run's folder ("" if there is none), and whether its first plan had steps."""
    logs = sorted(runs_dir.glob("*/events.jsonl"))
    if not logs:
        return "", False
    events = [json.loads(line) for line in logs[-1].read_text().splitlines()]
    plans = [e["steps"] for e in events if e["event"] == "plan"]
    return str(logs[-1].parent), bool(plans and plans[0])


def run_apart(name: str, runs_dir: Path, limit: float) -> Row:
    """Run one goal in a process of its own.

    Args:
        name: Key of `GOALS`.
        runs_dir: A folder of this name is made in it.
        limit: Wall time in [s] after which the process and the cell that it started are ended.
    """
    own = runs_dir / name
    command = python_module("benchmarks.goals.other_words", "--here", name, "--runs-dir", str(own))
    started = time.monotonic()
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            out, said = process.communicate(timeout=limit)
            why = f"ended with {process.returncode}: {said.strip().splitlines()[-1:]}"
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            out, said = process.communicate()
            why = f"not finished after {limit:g} s, last: {said.strip().splitlines()[-1:]}"
    if out.strip():
        return Row(**json.loads(out.splitlines()[-1]))
    folder, planned = _record(own)
    return Row(name, planned, planned, False, round(time.monotonic() - started, 1), why, folder)


def summary(rows: list[Row], of: GoalSet) -> dict[str, object]:
    """Counts and rows of goals of a set, ready for JSON."""
    counts = {stage: sum(getattr(r, stage) for r in rows) for stage in ("parsed", "planned", "done")}
    return {"written": of.written.isoformat(), "goals": len(rows), **counts, "rows": [asdict(r) for r in rows]}


def print_table(rows: list[Row], of: GoalSet) -> None:
    """One line a goal, and the counts."""
    print(f"{'goal':22} {'parsed':>6} {'planned':>7} {'done':>5} {'s':>6}  what was said")
    for r in rows:
        marks = ("yes" if stage else "no" for stage in (r.parsed, r.planned, r.done))
        print("{:22} {:>6} {:>7} {:>5} {:>6.1f}  {}".format(r.name, *marks, r.seconds, r.reason))
    refusals = sum(GOALS[r.name].reached is None for r in rows)
    print(
        f"{sum(r.done for r in rows)} of {len(rows)} ended as they should; {sum(r.parsed for r in rows)} were "
        f"understood, {sum(r.planned for r in rows)} planned; {refusals} are to be refused (written {of.written})"
    )


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", type=int, default=1, choices=list(SETS), help="which goals")
    parser.add_argument("--goals", nargs="+", metavar="GOAL", help="only these of the set")
    parser.add_argument("--jobs", type=int, default=1, help="goals at a time")
    parser.add_argument("--limit", type=float, default=LIMIT, help="seconds for one goal")
    parser.add_argument("--runs-dir", type=Path, default=None, help="default: runs/other_words/TIME")
    parser.add_argument("--plan-only", action="store_true", help="first plans from true poses, without any motion")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.add_argument("--here", choices=list(GOALS), metavar="GOAL", help="run one goal in this process")
    options = parser.parse_args()
    of = SETS[options.set]
    names = options.goals or list(of.goals)
    unknown = [name for name in names if name not in of.goals]
    if unknown:
        parser.error(f"set {options.set} has no goal '{unknown[0]}'; it has {', '.join(of.goals)}")
    if options.plan_only:
        plans = [plan_one(name) for name in names]
        if options.json:
            print(json.dumps(plan_summary(plans)))
        else:
            print_plans(plans)
        return 0
    runs_dir = options.runs_dir or Path("runs/other_words") / time.strftime("%Y-%m-%d_%H-%M-%S")
    if options.here:
        print(json.dumps(asdict(run_one(options.here, runs_dir))))
        return 0
    rows = []
    with ThreadPoolExecutor(options.jobs) as pool:
        for row in pool.map(lambda name: run_apart(name, runs_dir, options.limit), names):
            rows.append(row)
            print(f"{row.name}: {row.ended_at}, {row.seconds:.1f} s: {row.reason}", file=sys.stderr)
    if options.json:
        print(json.dumps(summary(rows, of)))
    else:
        print_table(rows, of)
    return 0


if __name__ == "__main__":
    sys.exit(main())
