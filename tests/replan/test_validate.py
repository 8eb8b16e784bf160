"""`replan validate`: what it says of good and bad motions, ours and other people's, and what it leaves to look at."""

import json
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.motion.motion_scenes import spec_of
from control.errors import ConfigError, MotionFileError, RefusedError
from control.motion_files.reading import read_motion
from control.motion_files.resampling import to_trajectory
from control.motion_files.trajectory_file import write_trajectory
from control.planners.motion_search import plan_motion
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.limits import REST_Q, panda_limits
from control.safety.certificate_file import read_certificate
from control.safety.certification import limits_hash, verify_certificate
from control.trajectory.samples import Trajectory
from replan.commands.validate import Validate
from replan.console import Console
from replan.validate.motion import Validation, validate_motion
from replan.validate.options import ValidateOptions, payload_from, reward_text, start_from
from replan.validate.report import worst_moments
from replan.validate.scene_source import scene_for
from replan.validate.text import as_json, as_text, check_rows
from sim_check.cells.loading import load_cell
from sim_check.twin.payloads import held_payloads
from sim_check.twin.twin import build_twin

ON_CRATE = 'minimize_l2_distance_reward("red_cube", "crate", primary_reward=True)'


@pytest.fixture(scope="module")
def pick() -> Trajectory:
    """The red cube of the cell `cubes` put on its crate."""
    cell = load_cell("cubes")
    twin = build_twin(cell, scene_for(cell, None), np.array(REST_Q), 0.08)
    spec, safety = spec_of("minimize_l2_distance", "red_cube", "crate"), cell.safety_limits()
    plan = plan_motion(twin, spec, safety, np.random.default_rng(0))
    assert not hasattr(plan, "kind"), plan
    return retime(plan.path, RobotModel.panda(), panda_limits(), safety, payloads=held_payloads(twin))  # type: ignore[union-attr]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, pick: Trajectory) -> Path:
    """A folder with the motion as our own file, and as somebody else's CSV (joints in another order, no velocities)."""
    out = tmp_path_factory.mktemp("motions")
    write_trajectory(out / "ours.npz", pick)
    widths = np.full(len(pick.q), 0.08)
    for event in pick.gripper:
        widths[round(event.time * 1000) :] = event.command.width
    rows = np.unique(np.append(np.arange(0, len(pick.q), 20), len(pick.q) - 1))
    names = [f"panda_joint{j}" for j in range(7, 0, -1)]
    lines = [",".join(["time_from_start", *names, "gripper_width"])]
    lines += [",".join(f"{v:.9f}" for v in (k / 1000, *pick.q[k, ::-1], widths[k])) for k in rows]
    (out / "theirs.csv").write_text("\n".join(lines) + "\n")
    return out


def judged(file: Path, **options) -> Validation:
    return validate_motion(ValidateOptions(file, **{"perturbed": 2, **options}), lambda _: None)


def broken(validation: Validation) -> set[str]:
    return {c.name for c in validation.verdict.failed_checks}


def test_our_own_motion_passes_and_says_what_it_handles_itself(folder, pick):
    validation = judged(folder / "ours.npz")
    assert validation.verdict.passed, as_text(validation, {})
    assert validation.exit_code == 0
    assert validation.trajectory.content_hash() == pick.content_hash(), "exactly the file's samples are judged"
    text = as_text(validation, {"report": "x.html"})
    assert text.startswith("passed: every check is kept, and 2 of 2 keep everything")
    for row in check_rows(validation):
        assert re.search(rf"^  ok +{row.name} ", text, re.MULTILINE)
    assert text.endswith("report: x.html")


def test_the_reward_is_judged_where_one_is_asked_for(folder):
    assert judged(folder / "ours.npz", reward=ON_CRATE).verdict.passed
    elsewhere = judged(folder / "ours.npz", reward=ON_CRATE.replace("crate", "yellow_cube"))
    assert "reward_met" in broken(elsewhere) and elsewhere.exit_code == 4
    assert "reward_met" not in {c.name for c in judged(folder / "ours.npz").verdict.checks}


def test_somebody_elses_motion_may_touch_nothing_until_it_is_said_what_it_handles(folder):
    theirs = folder / "theirs.csv"
    validation = judged(theirs)
    assert {"unwanted_contact", "finger_clearance"} <= broken(validation)
    assert "hint: if the motion is meant to handle 'red_cube', say --handles red_cube" in as_text(validation, {})
    handled = judged(theirs, handles=("red_cube",), touches=("crate",), reward=ON_CRATE)
    kept = {c.name for c in handled.verdict.checks} - broken(handled)
    assert {"unwanted_contact", "finger_clearance", "reward_met", "held_kept", "moved", "released"} <= kept


def test_retiming_makes_a_sound_motion_of_a_sound_path(folder):
    validation = judged(folder / "theirs.csv", retime=True, handles=("red_cube",), touches=("crate",), reward=ON_CRATE)
    assert validation.verdict.passed, as_text(validation, {})
    assert validation.retiming is not None and "retimed to" in validation.made
    slow = judged(folder / "theirs.csv", retime=True, fraction=0.2, handles=("red_cube",), touches=("crate",))
    assert slow.verdict.passed and slow.trajectory.duration > 1.3 * validation.trajectory.duration
    checks = {c.name: c for c in slow.verdict.checks}
    shares = np.abs(np.diff(slow.trajectory.q, axis=0)).max(axis=0) * 1000 / panda_limits().qd
    assert shares.max() <= 0.2 + 1e-6 and checks["joint_velocity"].ok


def test_the_example_of_the_documentation_is_refused_as_it_is_and_passes_when_it_is_retimed():
    example = Path(__file__).parents[2] / "docs" / "validate" / "pick.csv"
    handling = {"handles": ("red_cube",), "touches": ("crate",)}
    assert "joint_acceleration" in broken(judged(example, **handling))
    assert judged(example, retime=True, **handling).verdict.passed


def test_a_fault_is_named_with_its_moment_and_its_joint(tmp_path, pick):
    q = np.array(pick.q)
    q[3000:, 2] += 0.002  # a step of 2 mrad within one millisecond
    write_trajectory(tmp_path / "jump.npz", replace(pick, q=q))
    validation = judged(tmp_path / "jump.npz")
    assert {"joint_velocity", "joint_acceleration", "joint_jerk"} <= broken(validation)
    row = next(r for r in check_rows(validation) if r.name == "joint_velocity")
    assert row.bodies == "panda_joint3" and 2.99 < (row.result.at or 0) < 3.01
    assert any(m.broken and abs(m.time - 3.0) < 0.01 for m in worst_moments(validation))


def test_the_json_says_the_same_as_the_text(folder):
    validation = judged(folder / "ours.npz")
    data = json.loads(json.dumps(as_json(validation, {"report": "r.html"}, 1.5)))
    assert data["passed"] is True and data["trials"] == 2 and data["successes"] == 2 and len(data["interval"]) == 2
    assert {c["name"] for c in data["checks"]} == {c.name for c in validation.verdict.checks}
    assert set(data["checks"][0]) >= {"name", "worst", "limit", "unit", "ok", "at", "bodies", "meaning"}
    assert data["trajectory_hash"] == validation.trajectory.content_hash()


def test_a_verdict_without_a_camera_says_that_nobody_has_looked_and_does_not_judge_it(folder):
    validation = judged(folder / "ours.npz", perturbed=0)
    assert "unseen space: not judged: no camera has looked" in as_text(validation, {})
    told = as_json(validation, {}, 0.0)
    assert told["unseen"].startswith("not judged") and "unseen_volume" not in {c["name"] for c in told["checks"]}


def test_the_command_writes_a_page_that_needs_nothing_beside_it(folder, tmp_path, capsys):
    command = Validate(
        file=folder / "theirs.csv", out=tmp_path / "out", perturbed=1, save=tmp_path / "samples.npz", json=True
    )
    assert command.execute(Console(json=True, quiet=True)) == 4
    data = json.loads(capsys.readouterr().out)
    page = Path(data["report"]).read_text()
    assert page.count("<svg") == 3 and "data:image/jpeg;base64," in page
    assert not re.search(r'(src|href)="(?!data:|#)', page), "no file or address beside the page"
    for name in ("unwanted_contact", "panda_joint7", "torque rate", "theirs.csv", "red_cube"):
        assert name in page
    assert judged(tmp_path / "samples.npz").trajectory.content_hash() == data["trajectory_hash"]


def test_a_motion_that_passed_gets_a_certificate_for_exactly_its_samples(folder, tmp_path, capsys):
    saved, paper = tmp_path / "samples.npz", tmp_path / "certificate.json"
    motion = folder / "ours.npz"
    arguments = {"out": tmp_path, "perturbed": 6, "report": False, "save": saved, "certificate": paper}
    assert Validate(file=motion, **arguments).execute(Console(quiet=True)) == 0
    assert f"certificate: {paper}" in capsys.readouterr().out
    trajectory, cell = to_trajectory(read_motion(saved)), load_cell("cubes")
    limits = panda_limits()
    sign = limits_hash(limits, cell.safety_limits(), cell.robot.gripper_model)
    certificate = read_certificate(paper)
    robot = (limits.profile, limits.firmware, sign, time.time(), set(), trajectory.q[0], 300.0)
    verify_certificate(certificate, trajectory, *robot)
    other = replace(trajectory, q=trajectory.q + 1e-9)
    with pytest.raises(RefusedError, match="is not the one that was judged"):
        verify_certificate(certificate, other, *robot)


def test_a_motion_that_is_refused_gets_no_certificate(folder, tmp_path):
    paper = tmp_path / "certificate.json"
    command = Validate(
        file=folder / "theirs.csv", perturbed=6, report=False, save=tmp_path / "samples.npz", certificate=paper
    )
    assert command.execute(Console(quiet=True)) == 4 and not paper.exists()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [({"save": None}, r"say where they go, too: --save NAME\.npz"), ({"perturbed": 1}, r"tried in 6 or more")],
)
def test_a_certificate_that_would_rest_on_nothing_is_refused_at_once(tmp_path, changes, reason):
    arguments = {"save": tmp_path / "s.npz", "certificate": tmp_path / "c.json", "perturbed": 6} | changes
    with pytest.raises(ConfigError, match=reason):
        Validate(file=Path("never-read.csv"), **arguments).execute(Console(quiet=True))


def test_a_motion_that_starts_inside_something_is_refused_in_one_line(folder, tmp_path):
    scene = tmp_path / "scene.yaml"
    x, y = RobotModel.panda().tcp_pose(np.array(REST_Q))[:2, 3]
    scene.write_text(f"poses: {{crate: {{position: [{x:.3f}, {y:.3f}], extents: [0.2, 0.2, 0.8]}}}}")
    with pytest.raises(
        RefusedError, match=r"theirs\.csv, line 2: the motion starts in collision: panda_\w+ and crate"
    ) as e:
        judged(folder / "theirs.csv", scene=scene)
    assert e.value.code == "start_in_collision" and "mm" in str(e.value) and "\n" not in str(e.value)


def test_a_robot_that_stands_elsewhere_is_told(folder):
    q = np.array(REST_Q)
    q[0] += 0.1
    assert "start_state" in broken(judged(folder / "ours.npz", start=q))


def test_a_path_that_cannot_be_timed_is_refused_with_its_reason(folder):
    with pytest.raises(RefusedError, match=r"ours\.npz: the path cannot be timed: .*torque") as caught:
        judged(folder / "ours.npz", retime=True, payload_kg=30.0)
    assert caught.value.code == "cannot_be_retimed"


def test_a_payload_shows_in_the_torques(folder):
    def torque(**payload):
        return next(c for c in judged(folder / "ours.npz", **payload).verdict.checks if c.name == "torque").worst

    assert torque(payload_kg=2.0, payload_com=(0.0, 0.0, 0.1)) > torque() + 5.0


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"handles": ("blue_cube",)}, r"--handles names 'blue_cube', which the scene does not have; it has \['crate'"),
        ({"held": "blue_cube"}, r"--held names 'blue_cube'"),
        ({"touches": ("blue_cube",)}, r"--touches names 'blue_cube', which is neither object nor joint here"),
        ({"fraction": 0.5}, r"--fraction says how fast a motion is retimed; give --retime as well"),
        ({"fraction": 1.5, "retime": True}, r"--fraction 1\.5 is not valid; it is a share of the limits, 0 to 1"),
        ({"gripper_width": 0.2}, r"cannot be 0\.2 m open at the start; it opens from 0 to 0\.08 m"),
        ({"reward": "__import__('os')"}, r"--reward: "),
        ({"reward": 'minimize_l2_distance_reward("red_cube", "crate")'}, r"--reward: 0 terms say primary_reward=True"),
        ({"reward": ON_CRATE.replace("crate", "moon")}, r"--reward: .*moon"),
        ({"perturbed": -1}, r"give --perturbed 0 or more"),
        ({"scene": Path("nowhere.yaml")}, r"there is no scene file 'nowhere\.yaml'"),
    ],
)
def test_options_that_are_not_valid_say_what_would_be(folder, options, reason):
    with pytest.raises(ConfigError, match=reason):
        judged(folder / "ours.npz", **options)


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        (lambda: payload_from(-1.0, (0, 0, 0)), r"--payload-kg -1 .* is not valid"),
        (lambda: payload_from(np.nan, (0, 0, 0)), r"--payload-kg nan"),
        (
            lambda: start_from((0.0, -45.0, 0.0, -135.0, 0.0, 90.0, 45.0)),
            r"--start .* seven joint positions in \[rad\]",
        ),
        (lambda: reward_text("no/such/file"), r"--reward 'no/such/file' is neither reward calls nor a file"),
    ],
)
def test_numbers_that_are_not_valid_say_what_would_be(call, reason):
    with pytest.raises(ConfigError, match=reason):
        call()


def test_a_bad_file_is_named_before_anything_else_is_done(tmp_path):
    path = tmp_path / "empty.csv"
    path.write_text("")
    with pytest.raises(MotionFileError, match=r"empty\.csv' is empty"):
        judged(path, scene=Path("nowhere.yaml"))
