"""A PDDL planner in a process of its own, which can be ended when it takes too long and prints where nobody looks.

As a program (`python -m planning.baselines.solver DOMAIN PROBLEM`) it solves two files with pyperplan, by A* with an
admissible heuristic, so that plans are shortest, and prints one JSON object: the plan, or null when there is none.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

from control.errors import MachineError
from replan_base.processes import python_module

PLANNER = "pyperplan"
SEARCH = {"search": "astar", "heuristic": "hmax"}


class NoPlanError(Exception):
    """The planner has no plan; the message says why."""


def solve_files(domain: Path, problem: Path, seconds: float) -> list[tuple[str, tuple[str, ...]]]:
    """A shortest plan.

    Args:
        domain, problem: PDDL files.
        seconds: Wall time in [s] after which the planner is ended; a second or two go into its start.

    Returns:
        Actions in order: name and arguments, as the files have them.

    Raises:
        NoPlanError: There is none, or the time was up.
        MachineError: The planner is not installed or fell over.
    """
    command = python_module("planning.baselines.solver", str(domain), str(problem))
    # Among equally short plans it takes one by the order of its sets, which follows the hashes of strings.
    settled = {**os.environ, "PYTHONHASHSEED": "0"}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=seconds, stdin=subprocess.DEVNULL, env=settled
        )
    except subprocess.TimeoutExpired:
        raise NoPlanError(f"{PLANNER} found no plan within {seconds:g} s") from None
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
        raise MachineError(f"{PLANNER} ended with an error: {last}; is the extra 'baselines' installed?")
    plan = json.loads(done.stdout.strip().splitlines()[-1])
    if plan is None:
        raise NoPlanError(f"{PLANNER} finds no sequence of actions that leads to the goal")
    return [(name, tuple(arguments)) for name, arguments in plan]


def _solve(domain: str, problem: str) -> list[tuple[str, list[str]]] | None:
    from unified_planning.engines import PlanGenerationResultStatus as Status
    from unified_planning.io import PDDLReader
    from unified_planning.shortcuts import OneshotPlanner, get_environment

    get_environment().credits_stream = None
    with OneshotPlanner(name=PLANNER, params=SEARCH) as planner:
        result = planner.solve(PDDLReader().parse_problem(domain, problem))  # pyright: ignore[reportAttributeAccessIssue]
    if result.plan is not None:
        return [(a.action.name, [str(p) for p in a.actual_parameters]) for a in result.plan.actions]
    # Its A* is complete, but the interface to it calls every failure incomplete.
    if result.status in (Status.UNSOLVABLE_PROVEN, Status.UNSOLVABLE_INCOMPLETELY):
        return None
    raise SystemExit(f"{PLANNER} gave up: {result.status.name}")


if __name__ == "__main__":
    print(json.dumps(_solve(sys.argv[1], sys.argv[2])))
