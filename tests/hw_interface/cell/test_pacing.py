"""The loop of a robot process: what counts as standing still, wherever it happens."""

import time
from typing import cast

import pytest

from benchmarks.robot_side.perfect_robot import certificate, perfect_driver, swing
from hw_interface.cell.node import STATE_RATE, RobotNode
from hw_interface.cell.pacing import FROZEN_AFTER, Leash, run_loop

LONG = FROZEN_AFTER + 0.2  # [s]


def slow() -> None:
    time.sleep(LONG)


class OneSlowAnswer:
    """A node that answers one request in the middle of a motion and ends the loop once the arm rests."""

    state_period = 1.0 / STATE_RATE

    def __init__(self, answer, driver, leash: Leash) -> None:
        self._answer, self._driver, self._leash = answer, driver, leash
        self._calls = 0

    def serve(self, wait: float = 0.0) -> float:
        time.sleep(wait)
        self._calls += 1
        begun = time.monotonic()
        if self._calls == 10:
            self._answer()
        if not self._driver.moving:
            self._leash.end()
        return time.monotonic() - begun


@pytest.mark.parametrize(("used", "mode"), [(lambda: 0.0, "reflex"), (time.monotonic, "idle")])
def test_a_process_suspended_in_an_answer_does_not_go_on_but_a_slow_answer_is_waited_for(used, mode: str, monkeypatch):
    # Nothing is worked on while the answer lasts, or all of the time is: how much a busy machine gives does not matter.
    monkeypatch.setattr("hw_interface.cell.pacing.time.process_time", used)
    driver, _ = perfect_driver()
    motion = swing(0.5)
    driver.submit(motion, certificate(motion))
    leash = Leash()
    run_loop(driver, cast(RobotNode, OneSlowAnswer(slow, driver, leash)), leash, 1.0)
    assert driver.mode == mode
    error = driver.state().last_error
    assert (error.code if error else None) == ("frozen" if mode == "reflex" else None)


def test_a_process_suspended_between_answers_does_not_go_on():
    driver, _ = perfect_driver()
    motion = swing(0.5)
    driver.submit(motion, certificate(motion))

    class SuspendedLeash(Leash):
        calls = 0

        def ended(self) -> bool:
            self.calls += 1
            if self.calls == 10:
                slow()
            return super().ended()

    leash = SuspendedLeash()
    run_loop(driver, cast(RobotNode, OneSlowAnswer(lambda: None, driver, leash)), leash, 1.0)
    assert driver.mode == "reflex"
