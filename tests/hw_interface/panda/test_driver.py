"""The real driver plays through the unmodified libfranka what was certified, and stops when anything is wrong."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robot_side.fault_judgement import distance_from
from benchmarks.robot_side.panda_side import (
    PandaSide,
    acknowledge,
    certified,
    gate,
    panda_side,
    wait_for_mode,
    wait_for_progress,
)
from control.errors import RefusedError, RobotGoneError, StoppedError
from control.trajectory.samples import GripperCommand, Trajectory
from hw_interface.cell.audit_log import read_audit_log
from hw_interface.cell.client import CellClient, ExecutionReport
from tests.support.load.freezing import freeze, wake
from tests.support.robot_side.hw_support import joined

pytest.importorskip("panda_py", reason="the driver speaks through libfranka")
GATE = gate()
MOVE, IDLE, REFLEX = 2, 1, 4  # libfranka.RobotMode

pytestmark = pytest.mark.real_time


@pytest.fixture(scope="module")
def side(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PandaSide]:
    with panda_side(tmp_path_factory.mktemp("side")) as running:
        yield running


@pytest.fixture
def client(side: PandaSide) -> Iterator[CellClient]:
    with CellClient.connect(side.endpoint) as connected:
        if connected.state().mode != "idle":
            acknowledge(connected)
        yield connected


def there_and_back(client: CellClient, seconds: float = 1.5, grip: bool = False) -> Trajectory:
    """From where the arm is held to somewhere and back, with a gripper command in between or not."""
    q = np.array(client.state().q_d)
    way = np.array([0.3, 0.1, 0.0, 0.1, 0.0, 0.1, 0.0])
    commands = [GripperCommand("move", 0.05 if client.state().gripper_width > 0.06 else 0.07), None]
    return joined(np.array([q, q + way, q]), commands if grip else [None, None], seconds=seconds)


class Running:
    """A motion that is executed on a thread."""

    def __init__(self, client: CellClient, trajectory: Trajectory) -> None:
        self.report: ExecutionReport | None = None
        self.error: Exception | None = None
        self._thread = threading.Thread(target=self._run, args=(client, trajectory))
        self._thread.start()

    def _run(self, client: CellClient, trajectory: Trajectory) -> None:
        try:
            self.report = client.execute(trajectory, certified(trajectory, GATE))
        except Exception as error:
            self.error = error

    def join(self) -> "Running":
        self._thread.join(60.0)
        assert not self._thread.is_alive()
        return self


def commanded(side: PandaSide, folder: Path) -> np.ndarray:
    """Positions that the box was commanded in motions of the last minute, shape (n, 7)."""
    history = side.history(folder)
    moving = history.mode == MOVE
    moving[1:] |= moving[:-1]  # the command that ends a motion is followed in a millisecond that is idle already
    return history.q_d[moving]


def off_path(rows: np.ndarray, samples: np.ndarray) -> float:
    """Largest distance per joint in [rad] of rows (m, 7) from the path through samples (n, 7)."""
    return float(distance_from(rows, samples).max())


def rest_time(history, since: int) -> float:
    """Robot time in [s] from a moment, in [ms], until the commanded position no longer changes."""
    after = history.time >= since
    moving = np.flatnonzero(np.any(np.diff(history.q_d[after], axis=0) != 0.0, axis=1))
    return 0.0 if len(moving) == 0 else float(moving[-1] + 1) / 1000.0


def test_exactly_the_certified_samples_reach_the_control_box(side, client, tmp_path):
    motion = there_and_back(client, grip=True)
    report = client.execute(motion, certified(motion, GATE))
    assert report.completed and report.played == len(motion.q), report.detail
    assert report.max_tracking_error < 2e-3
    rows = commanded(side, tmp_path)
    # Every certified sample, in order and bit for bit; nothing else but waiting at a rest and joining it.
    wanted = [q for k, q in enumerate(motion.q) if k == 0 or np.any(q != motion.q[k - 1])]
    place = 0
    for row in rows:
        if place < len(wanted) and np.array_equal(row, wanted[place]):
            place += 1
    assert place == len(wanted)
    assert off_path(rows[::7], motion.q) < 1e-9
    assert report.final_state.gripper_width == pytest.approx(motion.gripper[0].command.width, abs=2e-3)


def test_a_slower_motion_keeps_to_the_same_path(side, client, tmp_path):
    motion = there_and_back(client)
    report = client.execute(motion, certified(motion, GATE), speed=0.6)
    assert report.completed, report.detail
    np.testing.assert_array_equal(report.final_state.q_d, motion.q[-1])
    assert off_path(commanded(side, tmp_path)[-4000::9], motion.q) < 1e-6
    client.set_speed(1.0)


def test_a_change_of_speed_in_the_middle_is_worked_out_beside_the_motion(side, client, tmp_path):
    motion = there_and_back(client, seconds=3.0)
    running = Running(client, motion)
    wait_for_progress(client, 400)
    client.set_speed(0.4)
    running.join()
    client.set_speed(1.0)
    assert running.report is not None and running.report.completed, running.error
    assert running.report.speed.min() < 0.45 and running.report.speed.max() > 0.95
    assert off_path(commanded(side, tmp_path)[-6000::9], motion.q) < 1e-6


def test_a_stop_rests_on_the_path_and_waits_for_an_acknowledgement(side, client, tmp_path):
    motion = there_and_back(client, seconds=3.0)
    running = Running(client, motion)
    wait_for_progress(client, 600)
    client.stop("a test")
    assert isinstance(running.join().error, StoppedError)
    assert client.state().mode == "stopped"
    assert off_path(np.array([client.state().q_d]), motion.q) < 1e-6
    again = there_and_back(client)
    with pytest.raises(RefusedError, match="the robot has stopped; acknowledge that first"):
        client.execute(again, certified(again, GATE))
    client.acknowledge()
    assert client.execute(again, certified(again, GATE)).completed


def test_a_collision_is_named_and_recovers_only_when_acknowledged(side, client):
    motion = there_and_back(client, seconds=3.0)
    running = Running(client, motion)
    wait_for_progress(client, 500)
    side.box.faults.send("push 2 60 0.3")
    report = running.join().report
    assert report is not None and not report.completed and report.reason == "reflex"
    assert "reflex" in report.detail and "the control box stopped the arm" in report.detail
    assert side.box.faults.send("state")["mode"] == "reflex"
    time.sleep(1.0)
    assert side.box.faults.send("state")["mode"] == "reflex", "nothing recovers by itself"
    client.acknowledge()
    assert side.box.faults.send("state")["mode"] == "idle"
    again = there_and_back(client)
    assert client.execute(again, certified(again, GATE)).completed


def test_a_user_stop_ends_the_motion_and_must_be_released_before_it_is_acknowledged(side, client):
    motion = there_and_back(client, seconds=3.0)
    running = Running(client, motion)
    wait_for_progress(client, 500)
    side.box.faults.send("user_stop on")
    report = running.join().report
    assert report is not None and report.reason == "user_stop" and "user stop was pressed" in report.detail
    with pytest.raises(RefusedError, match="the user stop is pressed; release it, then acknowledge"):
        client.acknowledge()
    side.box.faults.send("user_stop off")
    client.acknowledge()
    assert client.state().mode == "idle"


def test_a_user_stop_at_rest_latches_too(side, client):
    side.box.faults.send("user_stop on")
    wait_for_mode(client, "reflex")
    error = client.state().last_error
    assert error is not None and error.code == "user_stop"
    side.box.faults.send("user_stop off")
    motion = there_and_back(client)
    with pytest.raises(RefusedError, match="acknowledge"):
        client.execute(motion, certified(motion, GATE))
    client.acknowledge()
    assert client.state().mode == "idle"


def test_a_second_operator_is_refused_and_may_still_stop_the_robot(side, client):
    motion = there_and_back(client, seconds=3.0)
    running = Running(client, motion)
    wait_for_progress(client, 300)
    with CellClient.connect(side.endpoint) as other:
        with pytest.raises(RefusedError, match="the robot is moving"):
            other.execute(motion, certified(motion, GATE))
        other.stop("by somebody else")
        assert isinstance(running.join().error, StoppedError)
        other.acknowledge()
        motion = there_and_back(other)
        with pytest.raises(RefusedError, match="operates this robot, and one may at a time"):
            other.execute(motion, certified(motion, GATE))
    assert client.state().mode == "idle"


def test_an_operator_who_leaves_in_the_middle_takes_the_right_to_move_along(side, client, tmp_path):
    with CellClient.connect(side.endpoint) as leaving:
        motion = there_and_back(client, seconds=3.0)
        running = Running(leaving, motion)
        wait_for_progress(client, 500)
        # As when a program ends: its session closes under the motion.
        leaving.close()
        running.join()
    wait_for_mode(client, "reflex")
    error = client.state().last_error
    assert error is not None and error.code == "operator_gone"
    assert off_path(np.array([client.state().q_d]), motion.q) < 1e-6


def test_a_frozen_player_is_ended_by_the_watchdog_and_started_again_when_acknowledged(side, client):
    motion = there_and_back(client, seconds=3.0)
    running = Running(client, motion)
    wait_for_progress(client, 500)
    player = side.child("panda_player")
    freeze(player)
    report = running.join().report
    assert report is not None and report.reason == "driver_hung", running.error
    assert not Path(f"/proc/{player}").exists()
    wait_for_mode(client, "reflex")
    acknowledge(client)
    again = there_and_back(client)
    assert client.execute(again, certified(again, GATE)).completed


def test_while_nothing_moves_a_process_that_stands_still_breaks_nothing(side, client):
    supervisor, player, hand = side.supervisor.pid, side.child("panda_player"), side.child("panda_hand")
    for stalled, seconds in (((player, hand), 3.5), ((supervisor, player, hand), 1.5), ((supervisor,), 1.5)):
        for pid in stalled:
            freeze(pid)
        time.sleep(seconds)
        for pid in stalled:
            wake(pid)
        assert client.state().mode == "idle" and client.state().last_error is None
    assert side.child("panda_player") == player and side.child("panda_hand") == hand, "nobody was ended"
    motion = there_and_back(client, grip=True)
    assert client.execute(motion, certified(motion, GATE)).completed


def test_the_audit_log_tells_every_request_and_what_became_of_it(side, client):
    motion = there_and_back(client, seconds=0.8)
    certificate = certified(motion, GATE)
    client.execute(motion, certificate)
    with pytest.raises(RefusedError):
        client.execute(motion, certificate)
    lines = list(read_audit_log(side.audit_log))
    assert all(isinstance(line, dict) for line in lines)
    about = [line for line in lines if isinstance(line, dict) and line.get("serial") == certificate.serial]
    assert [line["event"] for line in about] == ["asked", "granted", "mode", "asked", "refused"]
    assert about[2]["outcome"] == "completed" and about[4]["code"] == "certificate_used"


def test_a_lost_supervisor_leaves_the_arm_at_rest_on_its_path_within_half_a_second(tmp_path):
    with panda_side(tmp_path) as side, CellClient.connect(side.endpoint) as client:
        motion = there_and_back(client, seconds=3.0)
        running = Running(client, motion)
        wait_for_progress(client, 500)
        os.kill(side.supervisor.pid, signal.SIGKILL)
        killed = int(str(side.box.faults.send("state")["milliseconds"]))
        assert isinstance(running.join().error, RobotGoneError)
        until = time.monotonic() + 10.0
        while side.box.faults.send("state")["mode"] != "idle":
            assert time.monotonic() < until
            time.sleep(0.05)
        history = side.history(tmp_path)
        assert rest_time(history, killed) <= 0.5
        assert off_path(history.q_d[-400::20], motion.q) < 1e-6
        assert np.abs(history.q[-1] - history.q_d[-1]).max() < 1e-3
        assert side.box.faults.send("state")["errors"] == [], "the player ended the motion itself"
