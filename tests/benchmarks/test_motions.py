"""The benchmark of motions: seeded scenes, errors that only the planner's twin has, and figures that cannot flatter."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.motion.motion_scenes import MOTIONS, draw_scene
from benchmarks.motion.motions import Job, Run, judged, run_job, summary, table
from control.safety.certificate import CheckResult, Verdict
from control.safety.table import safety_table

ROOT = Path(__file__).resolve().parents[2]


def scene_poses(twin):
    data = twin.start()
    return {o.name: data.body(o.name).xpos.copy() for o in twin.objects}


def test_a_scene_is_drawn_from_its_seed_alone():
    first, again, other = (scene_poses(draw_scene(MOTIONS["remove_bar"], s).true) for s in (4, 4, 5))
    assert all(np.array_equal(first[n], again[n]) for n in first)
    assert all(not np.allclose(first[n][:2], other[n][:2], atol=1e-3) for n in first)


def test_errors_are_in_the_planners_twin_and_mismatch_in_the_true_one():
    exact = scene_poses(draw_scene(MOTIONS["remove_bar"], 4).true)
    noisy, off = draw_scene(MOTIONS["remove_bar"], 4, 0.005), draw_scene(MOTIONS["remove_bar"], 4, mismatch=True)
    for name, position in exact.items():
        assert np.array_equal(scene_poses(noisy.true)[name], position)
        assert 1e-4 < np.linalg.norm(scene_poses(noisy.believed)[name] - position) < 0.03, name
        assert np.array_equal(scene_poses(off.believed)[name], position)
        assert 1e-4 < np.linalg.norm(scene_poses(off.true)[name] - position) < 0.02, name
    assert not np.array_equal(off.true.model.body_mass, off.believed.model.body_mass)
    assert not np.array_equal(off.true.model.actuator_gainprm, off.believed.model.actuator_gainprm)


def verdict(**worst):
    """A verdict in which some checks have a value above their limit."""
    limits = {row.name: max(row.limit) for row in safety_table()}
    checks = tuple(
        CheckResult(n, worst.get(n, 0.0), limit, "", worst.get(n, 0.0) <= limit, 0.0, ()) for n, limit in limits.items()
    )
    return Verdict(checks, 0, 0, (0.0, 1.0), all(c.ok for c in checks), 0)


@pytest.mark.parametrize(
    "worst, success, clean",
    [
        ({}, True, True),
        ({"arm_clearance": 0.01}, True, True),
        ({"unwanted_contact": 14.0}, True, True),
        ({"contact_force": 16.0}, True, False),
        ({"moved": 0.03}, True, False),
        ({"joint_moved": 0.03}, True, False),
        ({"tipped": 0.5}, True, False),
        ({"reward_met": 0.001}, False, False),
        ({"released": 5.0}, False, False),
        ({"settled": 0.5}, False, False),
    ],
)
def test_success_and_cleanness_are_what_the_benchmark_says_they_are(worst, success, clean):
    assert judged(verdict(**worst))[:2] == (success, clean)


def test_a_simulation_that_broke_down_is_no_success():
    broken = Verdict((CheckResult("simulation", float("inf"), 0.0, "m", False),), 0, 0, (0.0, 1.0), False, 0)
    assert judged(broken) == (False, False, float("inf"))


def test_figures_count_every_run_and_name_those_that_were_not_clean():
    good = Run(True, True, True, 1.0, 2.0, 0.5, 4000, 6.0, 0.0, "")
    bad = Run(False, False, False, 3.0, 4.0, 0.5, 8000, 6.0, 40.0, "reward_met 0.1 m")
    figures = summary([good, bad, good])
    assert (figures["runs"], figures["success"], figures["clean"]) == (3, 2, 2)
    assert (figures["median_wall_s"], figures["median_steps"], figures["peak_other_force_n"]) == (1.0, 4000, 40.0)
    assert figures["failures"] == {1: "reward_met 0.1 m"}
    assert "seed 1: reward_met 0.1 m" in table({"lift": figures})


def test_a_motion_is_planned_retimed_and_judged():
    run = run_job(Job("lift", 0, "candidates", 0.0, False, 1))
    assert run.passed and run.clean and run.steps > 1000 and 2.0 < run.duration_s < 6.0


def test_the_command_prints_json_and_lists_motions():
    command = [sys.executable, "-m", "replan.main", "bench", "motions", "--motions"]
    done = subprocess.run([*command, "lift", "--runs", "1", "--json"], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["motions"]["lift"]["clean"] == 1 and "[1/1] lift 0: clean" in done.stderr
    wrong = subprocess.run([*command, "dance"], capture_output=True, text=True, cwd=ROOT)
    assert wrong.returncode == 2 and "remove_bar" in wrong.stderr
