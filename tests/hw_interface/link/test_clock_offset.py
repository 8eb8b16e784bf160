"""The offset of two clocks by round trips: how sure, how long, and what happens when one of them is set anew."""

from collections.abc import Callable

import numpy as np
import pytest

from control.errors import RefusedError, RobotGoneError
from hw_interface.link.clock_offset import AGAIN, DRIFT, RobotClock


class TwoClocks:
    """This computer's clocks and the robot's, moved by hand; questions and answers take what a test says."""

    def __init__(self, offset: float, ways: Callable[[], tuple[float, float]] = lambda: (0.001, 0.001)) -> None:
        self.now = 1000.0  # monotonic
        self.base = 1.7e9  # wall less monotonic
        self.offset = offset
        self.ways = ways
        self.asked = 0
        self.clock = RobotClock(self.ask, self.wall, self.monotonic)

    def wall(self) -> float:
        return self.base + self.now

    def monotonic(self) -> float:
        return self.now

    def ask(self) -> float:
        there, back = self.ways()
        self.asked += 1
        self.now += there
        robot = self.wall() + self.offset
        self.now += back
        return robot


def test_the_quickest_round_trip_says_the_offset_and_half_of_it_how_sure():
    rng = np.random.default_rng(0)
    ways = [(float(a), float(b)) for a, b in rng.uniform(0.001, 0.05, (40, 2))]
    clocks = TwoClocks(-3.25, iter(ways).__next__)
    stamp = clocks.wall()
    quickest = min(sum(w) for w in ways[:12])
    assert abs(clocks.clock.to_robot(stamp) - (stamp - 3.25)) <= quickest / 2 + 1e-6
    assert clocks.clock.uncertainty == pytest.approx(quickest / 2, abs=AGAIN * DRIFT)
    assert clocks.clock.uncertainty is not None and clocks.clock.offset is not None
    assert abs(clocks.clock.offset + 3.25) <= clocks.clock.uncertainty + 1e-6


def test_one_way_that_is_slower_stays_within_the_uncertainty():
    clocks = TwoClocks(0.7, lambda: (0.016, 0.0))
    assert abs(clocks.clock.to_robot(0.0) - 0.7) == pytest.approx(0.008, abs=1e-6)
    assert clocks.clock.uncertainty is not None and clocks.clock.uncertainty >= 0.008 - 1e-9


def test_stamps_are_refused_when_the_link_is_too_slow_to_tell_the_time():
    clocks = TwoClocks(0.0, lambda: (0.03, 0.02))
    with pytest.raises(RefusedError, match="give or take 25 ms; at most 20 ms are allowed: use a") as caught:
        clocks.clock.to_robot(0.0)
    assert caught.value.code == "clock_unsure"


def test_the_offset_is_measured_again_in_time_and_less_sure_until_then():
    clocks = TwoClocks(1.0)
    clocks.clock.keep()
    first, asked = clocks.clock.uncertainty, clocks.asked
    clocks.now += AGAIN / 2
    clocks.clock.keep()
    assert clocks.asked == asked
    assert clocks.clock.uncertainty == pytest.approx((first or 0.0) + DRIFT * AGAIN / 2)
    clocks.now += AGAIN
    clocks.clock.keep()
    assert clocks.asked == 2 * asked and clocks.clock.jumps == 0


def test_a_clock_of_this_computer_that_is_set_is_noticed_before_the_next_stamp():
    clocks = TwoClocks(1.0)
    clocks.clock.keep()
    clocks.base += 5.0  # set forward: the robot is 4 s behind now
    clocks.offset -= 5.0
    stamp = clocks.wall()
    assert clocks.clock.to_robot(stamp) == pytest.approx(stamp - 4.0, abs=0.002)
    assert clocks.clock.jumps == 1


def test_a_clock_of_the_robot_that_is_set_is_noticed_at_the_next_measurement():
    clocks = TwoClocks(0.0)
    clocks.clock.keep()
    clocks.offset = 2.0
    clocks.now += AGAIN + 0.1
    stamp = clocks.wall()
    assert clocks.clock.to_robot(stamp) == pytest.approx(stamp + 2.0, abs=0.002)
    assert clocks.clock.jumps == 1


def test_clocks_that_drift_as_computers_do_do_not_count_as_set():
    clocks = TwoClocks(0.0)
    for _ in range(20):
        clocks.clock.keep()
        clocks.now += AGAIN + 1.0
        clocks.offset += 50e-6 * (AGAIN + 1.0)
    assert clocks.clock.jumps == 0


def test_a_robot_that_does_not_answer_is_told_and_changes_nothing():
    clocks = TwoClocks(0.5)
    clocks.clock.keep()

    def gone() -> tuple[float, float]:
        raise RobotGoneError("nobody there")

    clocks.ways = gone
    clocks.now += AGAIN + 1.0
    with pytest.raises(RobotGoneError):
        clocks.clock.to_robot(0.0)
    assert clocks.clock.offset == pytest.approx(0.5)
