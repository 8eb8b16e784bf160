"""The planners' benchmark replays exactly what a planner simulated, and reports it in a fixed form."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.motion.planner import PARTS, TASKS, Row, StackLooks, measure, print_table, simulate_bare, summary
from benchmarks.scenes.tabletop_twins import arm
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.safety.limits import SafetyLimits
from control.simulation.batches import SimulatedBatch, simulate

ROOT = Path(__file__).resolve().parents[2]
LIFT = "lift a cube"


def bench(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "benchmarks.motion.planner", *arguments],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )


def test_bare_simulation_ends_where_the_planner_s_did_and_takes_as_many_steps():
    twin, spec = TASKS[LIFT]()
    batches: list[SimulatedBatch] = []
    rng = np.random.default_rng(0)
    plan = plan_motion(twin, spec, SafetyLimits(), rng, arm(), nthread=1, observe=batches.append)
    assert isinstance(plan, MotionPlan) and plan.stats.steps == sum(b.steps for b in batches) > 0
    for batch in batches:
        np.testing.assert_array_equal(simulate_bare(batch), simulate(batch, ("qpos",))["qpos"][:, -1])


def test_an_observed_plan_is_the_plan_that_comes_without_an_observer():
    twin, spec = TASKS[LIFT]()
    one = plan_motion(twin, spec, SafetyLimits(), np.random.default_rng(0), arm(), nthread=1)
    two = plan_motion(twin, spec, SafetyLimits(), np.random.default_rng(0), arm(), nthread=1, observe=lambda _: None)
    assert isinstance(one, MotionPlan) and isinstance(two, MotionPlan)
    for a, b in zip(one.path.segments, two.path.segments, strict=True):
        np.testing.assert_array_equal(a.q, b.q)


def test_a_planner_is_measured_and_costs_more_than_its_bare_steps():
    row = measure("candidates", plan_motion, LIFT, 0, arm(), 1)
    assert row.found and row.steps > 0 and row.cpu > row.bare > 0
    assert set(row.parts) == set(PARTS) and sum(row.parts.values()) < row.cpu


def test_looks_at_the_stack_find_who_spends_the_time_and_end_with_the_measurement():
    with StackLooks() as looks:
        until = time.process_time() + 0.2
        while time.process_time() < until:
            arm().forward(np.zeros((2000, 7)))
    seen = looks.seconds
    assert 0.1 < seen["kinematics"] < 0.4 and seen["filter"] == 0.0
    until = time.process_time() + 0.05
    while time.process_time() < until:
        arm().forward(np.zeros((2000, 7)))
    assert looks.seconds == seen


def test_ratios_of_tasks_are_of_sums_and_that_of_a_planner_is_the_median_of_its_runs(capsys):
    parts = dict.fromkeys(PARTS, 0.1)
    rows = [Row("p", "a", True, 100, 2.0, 1.0, parts), Row("p", "a", False, 300, 9.0, 3.0, parts)]
    rows += [Row("p", "b", True, 100, 5.0, 1.0, parts), Row("q", "b", False, 0, 0.1, 0.0, parts)]
    figures = summary(rows)
    a = figures["p"]["tasks"]["a"]
    assert (a["ratio"], a["steps"], a["found"], a["runs"]) == (11.0 / 4.0, 200.0, 1, 2)
    assert figures["p"]["ratio_median"] == 3.0
    assert figures["q"]["tasks"]["b"]["ratio"] is None and figures["q"]["ratio_median"] is None
    print_table(figures)
    assert "median ratio of all runs: 3.00" in capsys.readouterr().out


def test_the_script_prints_one_json_object():
    out = bench("--planners", "candidates", "--tasks", LIFT, "--seeds", "1", "--json")
    assert out.returncode == 0, out.stderr
    figures = json.loads(out.stdout)["planner"]["candidates"]
    assert figures["tasks"][LIFT]["cpu_s"] > figures["tasks"][LIFT]["bare_cpu_s"] > 0
    assert figures["tasks"][LIFT]["steps"] > 0
    assert figures["ratio_median"] == pytest.approx(figures["tasks"][LIFT]["ratio"])


def test_an_unknown_planner_is_answered_with_those_there_are():
    out = bench("--planners", "rrt")
    assert out.returncode == 2
    assert "no motion planner named 'rrt'; there are ['candidates', 'predictive-sampling']" in out.stderr
