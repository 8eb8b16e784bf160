"""One operator at a time, for as long as it lives and its heart beats."""

import time
from collections.abc import Iterator

import pytest
import zenoh

from control.errors import RefusedError
from hw_interface.cell.operator_lease import (
    BEAT_KEY,
    BEAT_LEASE,
    BEAT_PERIOD,
    OPERATOR_KEY,
    Operator,
    OperatorLease,
    operator_label,
)
from hw_interface.link.transport import open_client_session, open_robot_session


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def sessions() -> Iterator[tuple[zenoh.Session, zenoh.Session, zenoh.Session]]:
    robot, endpoint = open_robot_session("tcp/127.0.0.1:0")
    one, other = open_client_session(endpoint), open_client_session(endpoint)
    yield robot, one, other
    for session in (one, other, robot):
        session.close()


def until(condition, deadline: float = 5.0) -> bool:
    end = time.monotonic() + deadline
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return False


def test_the_first_operator_keeps_the_robot_until_it_leaves(sessions):
    robot, one, other = sessions
    lease = OperatorLease(robot)
    with Operator(one) as first, Operator(other) as second:
        assert lease.take(first.identity) == operator_label()
        with pytest.raises(RefusedError, match="operates this robot, and one may at a time; wait until") as refused:
            lease.take(second.identity)
        assert refused.value.code == "other_operator"
        assert lease.lost() is None
        first.close()
        assert until(lambda: lease.lost() is not None)
        assert "the operator's program has ended, or its link is cut" in (lease.lost() or "")
        assert lease.take(second.identity) == operator_label()
        second.close()
        second.close()


def test_nobody_is_no_operator(sessions):
    lease = OperatorLease(sessions[0])
    with pytest.raises(RefusedError, match="operator is not there any more; connect and send it again") as refused:
        lease.take("0" * 32)
    assert refused.value.code == "no_operator" and lease.lost() == "nobody operates the robot"


def test_a_program_whose_heart_has_stopped_is_lost_though_its_link_lives(sessions):
    robot, one, _ = sessions
    clock = Clock()
    lease = OperatorLease(robot, clock)
    token = one.liveliness().declare_token(f"{OPERATOR_KEY}/abc/somebody@here")  # a program without a heartbeat
    assert lease.take("abc") == "somebody@here"
    looks = 0
    while (why := lease.lost()) is None:
        clock.now += 0.01
        looks += 1
    assert looks * 0.01 == pytest.approx(BEAT_LEASE, abs=0.02)
    assert "was not heard for 1.0 s: it is frozen, its link is cut, or it computes without letting its other" in why
    assert lease.lost(patience=60.0) is None, "a simulation has more patience"
    token.undeclare()


def test_each_beat_begins_the_silence_anew(sessions):
    robot, one, _ = sessions
    clock = Clock()
    lease = OperatorLease(robot, clock)
    token = one.liveliness().declare_token(f"{OPERATOR_KEY}/abc/somebody@here")
    lease.take("abc")
    clock.now += 0.15
    assert lease.silence() == pytest.approx(0.15)
    one.put(f"{BEAT_KEY}/abc", b"")
    assert until(lambda: lease.silence() == 0.0)
    assert lease.lost() is None
    token.undeclare()


def test_time_in_which_the_robot_side_itself_stood_still_does_not_count(sessions):
    robot, one, _ = sessions
    clock = Clock()
    lease = OperatorLease(robot, clock)
    token = one.liveliness().declare_token(f"{OPERATOR_KEY}/abc/somebody@here")
    lease.take("abc")
    assert lease.lost() is None
    clock.now += 60.0
    assert lease.lost() is None, "what was not heard in a minute of standing still says nothing"
    clock.now += 0.1
    assert lease.lost() is None
    for _ in range(9):
        clock.now += 0.1
        lease.lost()
    assert lease.lost() is not None, "but who is silent afterwards is lost"
    token.undeclare()


def test_an_operator_beats_by_itself_until_it_is_closed(sessions):
    robot, one, _ = sessions
    beats: list[str] = []
    subscriber = robot.declare_subscriber(f"{BEAT_KEY}/*", lambda sample: beats.append(str(sample.key_expr)))
    with Operator(one) as operator:
        assert until(lambda: len(beats) >= 10)
        assert set(beats) == {f"{BEAT_KEY}/{operator.identity}"}
    time.sleep(0.1)  # for the last one on its way
    heard = len(beats)
    time.sleep(4 * BEAT_PERIOD)
    assert len(beats) == heard
    subscriber.undeclare()
