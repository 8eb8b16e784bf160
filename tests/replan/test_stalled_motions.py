"""A motion that a stalled process ended: a run goes on by itself only in a simulated cell, and only when told so."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from benchmarks.robot_side.perfect_robot import certificate, swing
from control.errors import ConfigError, StoppedError
from control.tasks.reward_spec import RewardSpec, RewardTerm
from hw_interface.cell.client import ExecutionReport
from replan.run.episode import Episode
from replan.run.film import Film
from replan.run.motion_finder import JudgedMotion
from replan.run.motion_player import MotionPlayer
from replan.run.readiness import check_simulated
from replan.run.session import RunSession
from replan.run.stopwatch import Stopwatch
from sim_check.cells.loading import load_cell

DETAIL = "the operator's program was not heard for 60.1 s; look at the cell, then acknowledge"


@dataclass
class Robot:
    """A robot side whose motions all end for one reason."""

    simulated: bool
    reason: str
    acknowledged: int = 0
    info: Any = field(init=False)

    def __post_init__(self) -> None:
        self.info = SimpleNamespace(simulated=self.simulated)

    def state(self) -> Any:
        return SimpleNamespace(stamp=0.0, speed_wanted=1.0, grasped=False)

    def execute(self, trajectory, _certificate, on_progress) -> ExecutionReport:
        rows = np.zeros((1, 7))
        one = np.zeros(1)
        return ExecutionReport(
            False, self.reason, DETAIL, 100, len(trajectory.q), 0.0, one, rows, rows, rows, one, one, self.state()
        )

    def acknowledge(self) -> None:
        self.acknowledged += 1


def play(robot: Robot, told: bool, tmp_path, monkeypatch) -> Any:
    monkeypatch.setattr("replan.run.motion_player.render_twin", lambda _twin: np.zeros((2, 2, 3), np.uint8))
    motion = swing(0.5)
    monkeypatch.setattr("replan.run.motion_player.issue_certificate", lambda *_, **__: certificate(motion))
    cell = load_cell("cubes")
    episode = Episode.create(tmp_path, "stalled")
    said: list[str] = []
    session = RunSession(cast(Any, robot), cell, cell.robot.limits(), episode, Film(), said.append, Stopwatch())
    spec = RewardSpec((RewardTerm("minimize_l2_distance", "palm", "red_cube", primary=True),))
    judged = JudgedMotion(spec, cast(Any, SimpleNamespace(scene_stamp=0.0)), cast(Any, None), motion, cast(Any, None))
    return MotionPlayer(session, False, told).play(judged), said


@pytest.mark.parametrize("reason", ["operator_gone", "frozen"])
def test_in_a_simulated_cell_that_is_told_so_it_acknowledges_and_the_loop_looks_again(reason, tmp_path, monkeypatch):
    robot = Robot(simulated=True, reason=reason)
    result, said = play(robot, True, tmp_path, monkeypatch)
    assert robot.acknowledged == 1
    assert not result.ok and result.cause.kind == "refused_by_robot" and result.cause.check == reason
    assert any("at rest on its path" in line and "acknowledged, looking again" in line for line in said)


@pytest.mark.parametrize(
    ("simulated", "reason", "told"),
    [(False, "frozen", True), (True, "frozen", False), (True, "contact", True)],
    ids=["a real robot", "not told so", "another reason"],
)
def test_everything_else_waits_for_a_person(simulated: bool, reason: str, told: bool, tmp_path, monkeypatch):
    robot = Robot(simulated=simulated, reason=reason)
    with pytest.raises(StoppedError, match="look at the cell, then acknowledge"):
        play(robot, told, tmp_path, monkeypatch)
    assert robot.acknowledged == 0


def test_in_front_of_a_real_robot_the_option_is_refused():
    with pytest.raises(ConfigError, match="--go-on-after-stall is for simulated cells"):
        check_simulated(cast(Any, Robot(simulated=False, reason="")))
    check_simulated(cast(Any, Robot(simulated=True, reason="")))
