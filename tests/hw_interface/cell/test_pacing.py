"""The loop of a robot process: what counts as standing still, wherever it happens. Its clock is set by hand."""

from collections.abc import Callable
from typing import cast

import pytest

from benchmarks.robot_side.perfect_robot import certificate, perfect_driver, swing
from hw_interface.cell.node import STATE_RATE, RobotNode
from hw_interface.cell.pacing import FROZEN_AFTER, Leash, run_loop

LONG = FROZEN_AFTER + 0.2  # [s]


class Clock:
    """What the loop asks for the time: a millisecond passes with every look, all of it worked on.

    Attributes:
        now: Time in [s].
        worked: What this process has worked in [s].
    """

    def __init__(self) -> None:
        self.now = self.worked = 0.0

    def monotonic(self) -> float:
        self.now += 0.0001
        self.worked += 0.0001
        return self.now

    def process_time(self) -> float:
        return self.worked


@pytest.fixture
def clock(monkeypatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr("hw_interface.cell.pacing.time", clock)
    return clock


class OneSlowAnswer:
    """A node that answers one request in the middle of a motion and ends the loop once the arm rests."""

    state_period = 1.0 / STATE_RATE

    def __init__(self, clock: Clock, driver, leash: Leash, answer: Callable[[], None], simulated: bool = False) -> None:
        self._clock, self._driver, self._leash, self._answer = clock, driver, leash, answer
        self.simulated, self.silent, self.calls = simulated, range(0), 0

    @property
    def waiting(self) -> bool:
        return self.calls in self.silent

    def serve(self, wait: float = 0.0) -> float:
        self._clock.now += wait
        self.calls += 1
        begun = self._clock.now
        if self.calls == 10:
            self._answer()
        if not self._driver.moving:
            self._leash.end()
        return self._clock.now - begun


def play(clock: Clock, answer: Callable[[], None] = lambda: None, simulated: bool = False, leash: Leash | None = None):
    """The driver and the node after a motion."""
    driver, robot = perfect_driver()
    motion = swing(0.5)
    driver.submit(motion, certificate(motion))
    leash = leash or Leash()
    node = OneSlowAnswer(clock, driver, leash, answer, simulated)
    run_loop(driver, cast(RobotNode, node), leash, 1.0)
    return driver, robot


def suspend(clock: Clock) -> None:
    clock.now += LONG


def work(clock: Clock) -> None:
    clock.now += LONG
    clock.worked += LONG


@pytest.mark.parametrize(("spend", "mode"), [(suspend, "reflex"), (work, "idle")])
def test_a_process_suspended_in_an_answer_does_not_go_on_but_a_slow_answer_is_waited_for(clock: Clock, spend, mode):
    driver, _ = play(clock, lambda: spend(clock))
    assert driver.mode == mode
    error = driver.state().last_error
    assert (error.code if error else None) == ("frozen" if mode == "reflex" else None)


class SuspendedLeash(Leash):
    """The process stands still between two answers."""

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock, self._calls = clock, 0

    def ended(self) -> bool:
        self._calls += 1
        if self._calls == 10:
            suspend(self._clock)
        return self._told.is_set()


def test_a_process_suspended_between_answers_does_not_go_on(clock: Clock):
    driver, _ = play(clock, leash=SuspendedLeash(clock))
    assert driver.mode == "reflex"


def test_a_simulation_goes_on_wherever_its_process_was_suspended_because_nothing_moved_meanwhile(clock: Clock):
    for driver, robot in (
        play(clock, lambda: suspend(clock), simulated=True),
        play(clock, simulated=True, leash=SuspendedLeash(clock)),
    ):
        assert driver.mode == "idle" and driver.state().last_error is None
        assert driver.state().progress == driver.state().samples == 501
        assert len(robot.commands) < 501 + 50, "and takes no more robot time than the motion has"


def test_a_simulations_time_stands_still_while_its_operator_is_silent(clock: Clock):
    driver, robot = perfect_driver()
    motion = swing(0.5)
    driver.submit(motion, certificate(motion))
    leash = Leash()
    node = OneSlowAnswer(clock, driver, leash, lambda: None, simulated=True)
    node.silent = range(20, 1020)  # looks of 5 ms
    played: set[int] = set()
    serve = node.serve

    def watched(wait: float = 0.0) -> float:
        spent = serve(wait)
        if node.waiting:
            played.add(len(robot.commands))
        return spent

    node.serve = watched  # pyright: ignore[reportAttributeAccessIssue]
    run_loop(driver, cast(RobotNode, node), leash, 1.0)
    assert len(played) == 1, "nothing is commanded meanwhile"
    assert clock.now > 5.0, "which lasts"
    assert driver.mode == "idle" and driver.state().progress == 501, "and the motion is played to its end afterwards"
