"""A clearance ends at rest on the certified path, and a player takes none that lies or was damaged."""

from collections.abc import Callable
from concurrent.futures import Future

import numpy as np
import pytest

from benchmarks.robot_side.perfect_robot import gate, swing
from control.errors import RefusedError
from control.robot.limits import REST_Q, panda_limits
from control.trajectory.playback import PROGRESS, Playback
from control.trajectory.samples import GripperCommand, Trajectory
from hw_interface.cell.backend import Measured
from hw_interface.cell.motion_monitor import MonitorLimits
from hw_interface.panda.board import RING, ClearanceBoard
from hw_interface.panda.clearance import JOIN_ROWS, MOST_ROWS, Clearance, ClearedPath, clear
from hw_interface.panda.cleared_motion import ClearedMotion
from hw_interface.panda.collision import FREE, HANDLING, thresholds
from hw_interface.panda.parts import moving_events, parts_of
from tests.support.robot_side.hw_support import joined

LIMITS = panda_limits()
MOTION = swing(2.0, 0.8)
END = len(MOTION.q) - 1


def path(motion: Trajectory = MOTION, held: np.ndarray | None = None) -> ClearedPath:
    """A player's view of a motion that is one part."""
    q_held = motion.q[0] if held is None else held
    return ClearedPath(motion.q, LIMITS, 0, 0.0, 0, len(motion.q) - 1, q_held)


def first_clearance(lead: int = 200) -> Clearance:
    return clear(Playback.of(MOTION), 1, lead, END, END, LIMITS)


def test_what_is_cleared_is_the_plan_and_then_a_rest_on_the_path():
    for first in (1, 300, 900, 1500):
        playback = Playback.of(MOTION)
        clearance = clear(playback, first, 200, END, END, LIMITS)
        planned = clearance.progress[: clearance.planned - first + 1]
        np.testing.assert_array_equal(planned, playback.clock[first : clearance.planned + 1, PROGRESS])
        steps = np.diff(clearance.progress)
        assert steps.min() > -1e-9 and steps.max() < 1 + 1e-9
        assert clearance.last == END or steps[-1] < 0.05, "it slows down to rest"


def test_near_its_end_a_part_is_cleared_to_its_end():
    clearance = clear(Playback.of(MOTION), END - 100, 200, END, END, LIMITS)
    assert clearance.last == clearance.planned == END and clearance.progress[-1] == END


def test_a_player_that_hears_nothing_more_comes_to_rest_within_every_limit():
    cleared = path()
    assert cleared.accept(first_clearance(), 0) is None
    assert cleared.accept(clear(Playback.of(MOTION), 201, 400, END, END, LIMITS), 150) is None
    rows = np.array([cleared.command(k) for k in range(JOIN_ROWS + cleared.last + 50)])
    np.testing.assert_array_equal(rows[-1], rows[-40], err_msg="at rest")
    stream = np.concatenate([np.repeat(rows[:1], 3, axis=0), rows])
    for order, limit in ((1, LIMITS.qd), (2, LIMITS.qdd), (3, LIMITS.qddd)):
        assert np.all(np.abs(np.diff(stream, n=order, axis=0)) / 1e-3**order <= limit + 1e-6)
    played = rows[JOIN_ROWS : JOIN_ROWS + cleared.planned + 1]
    np.testing.assert_array_equal(played, MOTION.q[: len(played)], err_msg="bit for bit as far as it was planned")


def test_an_arm_that_is_held_a_little_beside_the_first_sample_joins_it_smoothly():
    held = MOTION.q[0] + np.array([1e-4, -8e-5, 5e-5, 0, 0, 1e-4, -1e-4])
    cleared = path(held=held)
    cleared.accept(first_clearance(), 0)
    rows = np.array([cleared.command(k) for k in range(JOIN_ROWS + 100)])
    np.testing.assert_array_equal(rows[0], held)
    np.testing.assert_array_equal(rows[JOIN_ROWS:], MOTION.q[: len(rows) - JOIN_ROWS])
    stream = np.concatenate([np.repeat(rows[:1], 3, axis=0), rows[: JOIN_ROWS + 1]])
    assert np.all(np.abs(np.diff(stream, n=2, axis=0)) / 1e-6 < 0.5) and np.all(
        np.abs(np.diff(stream, n=3, axis=0)) / 1e-9 < 200.0
    )


def changed(progress: np.ndarray, **changes: int) -> Clearance:
    return Clearance(changes.get("first", 1), progress, changes.get("planned", 100))


@pytest.mark.parametrize(
    ("clearance", "why"),
    [
        (changed(np.arange(1.0, 300.0), first=0), "late"),
        (changed(np.arange(1.0, 300.0), first=5), "do not follow row 0"),
        (changed(np.arange(0.0)), "do not follow"),
        (changed(np.full(300, np.nan)), "progress is not finite"),
        (changed(np.arange(1.0, 300.0) * 1.5), "0 to 1 is allowed"),
        (changed(np.concatenate([np.arange(1.0, 200.0), [150.0]])), "0 to 1 is allowed"),
        (changed(np.concatenate([np.arange(1.0, 600.0), np.full(100, 599.0)])), "would break the robot's limit"),
        (changed(np.minimum(np.arange(1.0, END + 10), END + 5.0)), "leaves the part's samples"),
    ],
)
def test_a_player_refuses_a_clearance_that_is_not_what_it_should_be(clearance: Clearance, why: str):
    cleared = path()
    answer = cleared.accept(clearance, 0)
    assert answer is not None and why in answer
    np.testing.assert_array_equal(cleared.command(10_000), MOTION.q[0], err_msg="and stays where it was cleared to")


def test_a_late_clearance_leaves_the_one_before_it_in_force():
    cleared = path()
    first = first_clearance()
    assert cleared.accept(first, 0) is None
    assert cleared.accept(clear(Playback.of(MOTION), 201, 200, END, END, LIMITS), 201) == "late"
    assert cleared.last == first.last


def test_a_rest_that_is_too_far_away_is_refused():
    endless = swing(40.0, 0.2)
    motion = Trajectory(endless.q, endless.qd, endless.qdd)
    playback = Playback.of(motion)
    clearance = clear(playback, 1, 200, len(motion.q) - 1, len(motion.q) - 1, LIMITS)
    assert clearance.last < 1000, "a stop is near"
    with pytest.raises(RefusedError, match=f"a clearance reaches 1 to {MOST_ROWS} ms: plan the motion with stops"):
        clear(playback, 1, len(motion.q), len(motion.q) - 1, len(motion.q) - 1, LIMITS)


def test_a_trajectory_falls_into_parts_where_the_arm_rests():
    q = np.array([REST_Q] * 4) + np.arange(4)[:, None] * 0.1
    commands = [GripperCommand("move", 0.08), GripperCommand("grasp", 0.04), None]
    parts = parts_of(joined(q, commands, held=(None, None, "red_cube")))
    assert [(p.start, p.stop) for p in parts] == [(0, 1000), (1600, 2600), (3200, 4200)]
    assert [p.gripper.command.kind if p.gripper else None for p in parts] == ["move", "grasp", None]
    assert [p.held for p in parts] == [False, False, True]
    assert [thresholds(p) for p in parts] == [HANDLING, HANDLING, HANDLING]
    assert thresholds(parts_of(swing(1.0, 0.1))[0]) == FREE


def test_a_gripper_command_in_mid_motion_cuts_nothing():
    from dataclasses import replace

    from control.trajectory.samples import GripperEvent

    event = GripperEvent(0.5, 0.3, GripperCommand("move", 0.02))
    motion = replace(swing(1.0, 0.3), gripper=(event,))
    parts = parts_of(motion)
    assert len(parts) == 1 and moving_events(motion, parts) == (event,)


def test_two_sides_share_a_board_and_notice_damage():
    supervisor = ClearanceBoard.create()
    import os

    player = ClearanceBoard(os.dup(supervisor.descriptor))
    assert player.order() is None
    clearance = first_clearance()
    sequence = supervisor.post(3, 1, clearance)
    order = player.order()
    assert order is not None and (order.sequence, order.motion, order.part) == (sequence, 3, 1)
    np.testing.assert_array_equal(order.clearance.progress, clearance.progress)
    assert player.order() is None, "each is read once"
    player.tell_order(sequence, None)
    assert supervisor.taken == sequence
    supervisor.post(3, 1, clearance)
    supervisor._order["progress"][0, 7] += 1e-9
    assert player.order() is None, "a changed bit makes it no order"


def test_measurements_come_in_order_and_those_that_were_lost_are_missed():
    supervisor = ClearanceBoard.create()
    for k in range(RING + 500):
        place = supervisor.next_measurement()
        place["q"] = k
        supervisor.publish_measurement()
    rows = supervisor.measurements(0)
    assert rows["number"][-1] == supervisor.written == RING + 500
    assert np.all(np.diff(rows["number"].astype(int)) == 1) and rows["number"][0] > 400
    assert len(supervisor.measurements(RING + 490)) == 10


class NeverDone:
    """Takes work and does not do it."""

    def submit(self, *_: object) -> Future:
        return Future()


def supervised(motion: ClearedMotion, cleared: ClearedPath, until: int, each: Callable[[int], None]) -> list[str]:
    """Play rows as a supervisor and its player do, five at a time; returns what was said of changes of speed."""
    said = []
    assert cleared.accept(motion.begin_part(), 0) is None
    for row in range(0, until, 5):
        at = MOTION.q[min(row, END)]
        motion.observe(row, at, Measured(at, np.zeros(7), np.zeros(7), 0.08, False, False), 0.0)
        each(row)
        if (why := motion.thought()) is not None:
            said.append(why)
        if (clearance := motion.next_clearance()) is not None:
            assert cleared.accept(clearance, row) is None
        assert row < cleared.planned or cleared.last == END, "the arm never slows down for want of a clearance"
    return said


def cleared_motion(thinker: object) -> ClearedMotion:
    return ClearedMotion(MOTION, "serial", 1.0, gate(), MonitorLimits(), 0.0, 1, thinker)  # type: ignore[arg-type]


def test_a_motion_is_cleared_piece_by_piece_to_its_end():
    motion, cleared = cleared_motion(NeverDone()), path()
    assert supervised(motion, cleared, END + 1, lambda row: None) == []
    rows = np.array([cleared.command(k) for k in range(JOIN_ROWS + END - 900, JOIN_ROWS + END + 1)])
    np.testing.assert_array_equal(rows, MOTION.q[END - 900 :])


def test_a_change_of_speed_that_is_not_worked_out_in_time_is_given_up_and_stops_nothing():
    motion, cleared = cleared_motion(NeverDone()), path()
    said = supervised(motion, cleared, END + 1, lambda row: motion.change_speed(0.5, gate()) if row == 300 else None)
    assert said == ["it was not worked out in time; ask again"]
    assert cleared.last == END


def test_a_stop_replaces_what_was_planned_and_ends_on_the_path():
    motion, cleared = cleared_motion(NeverDone()), path()
    stopped: list[int] = []

    def stop(row: int) -> None:
        if row == 800:
            motion.stopping = True
            motion.stop()
            stopped.append(row)

    supervised(motion, cleared, 830, stop)
    assert stopped and cleared.last < 800 + 400
    end = cleared.command(10_000)
    k = int(np.argmin(np.abs(MOTION.q - end).max(axis=1)))
    assert np.abs(MOTION.q[k] - end).max() < 1e-3 and 800 < k < 1200
