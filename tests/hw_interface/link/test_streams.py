"""States at a high rate: a slow reader misses old ones, and holds up neither itself nor the robot."""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import pytest
import zenoh

from benchmarks.robot_side.perfect_robot import perfect_driver
from hw_interface.link.streams import StateReader, declare_stream
from hw_interface.link.transport import STATE_KEY, open_client_session, open_listening_session
from hw_interface.messages.robot import RobotState
from hw_interface.messages.wire import encode
from tests.support.waiting import GENEROUS, until

SLOW = 0.02  # [s] that a slow reader takes over a state
RATE = 1000  # states a second
PICTURE = b"p" * 4_000_000


@pytest.fixture
def state() -> RobotState:
    return perfect_driver()[0].state()


@pytest.fixture
def link() -> Iterator[tuple[zenoh.Session, zenoh.Session]]:
    """A robot's session and a client's."""
    robot, endpoint = open_listening_session("tcp/127.0.0.1:0")
    client = open_client_session(endpoint)
    yield robot, client
    client.close()
    robot.close()


def numbered(state: RobotState, number: int) -> bytes:
    return encode(state.model_copy(update={"progress": number}))


def test_a_slow_reader_still_gets_its_answers_at_once_and_the_latest_states(link, state: RobotState):
    robot, client = link
    heard: list[int] = []

    def on_state(state: RobotState) -> None:
        heard.append(state.progress)
        time.sleep(SLOW)

    reader = StateReader(client, on_state, backlog=10)
    robot.declare_queryable("cell/frame/camera", lambda query: query.reply(query.key_expr, PICTURE))
    stream = declare_stream(robot, STATE_KEY)
    assert until(lambda: stream.matching_status.matching)  # pyright: ignore[reportAttributeAccessIssue]
    overtaken: list[int] = []  # states that were on their way when an answer came
    messages = [numbered(state, number) for number in range(4 * RATE)]
    sent = 0
    while sent < len(messages):
        stream.put(messages[sent])
        sent += 1
        time.sleep(1.0 / RATE)
        if sent % (RATE // 2) == 0:
            replies = list(client.get("cell/frame/camera", timeout=GENEROUS))
            assert [reply.ok is not None for reply in replies] == [True], "the link is alive"
            overtaken.append(sent - 1 - heard[-1])
    assert max(overtaken) > 1, "no answer waits for the reader"
    assert until(lambda: heard[-1] == sent - 1), "what is heard last is the latest"
    assert len(heard) < sent / 2, "the reader was slow indeed"
    assert heard == sorted(set(heard))
    reader.close()


def test_a_reader_that_keeps_up_hears_every_state(link, state: RobotState):
    robot, client = link
    heard: list[int] = []
    StateReader(client, lambda state: heard.append(state.progress))
    stream = declare_stream(robot, STATE_KEY)
    assert until(lambda: stream.matching_status.matching)  # pyright: ignore[reportAttributeAccessIssue]
    for number in range(200):
        stream.put(numbered(state, number))
        time.sleep(0.002)
    assert until(lambda: len(heard) == 200), sorted(set(range(200)) - set(heard))


def test_neither_garbage_nor_a_fault_of_the_reader_ends_the_reading(link, state: RobotState, caplog):
    robot, client = link
    heard: list[int] = []

    def on_state(state: RobotState) -> None:
        heard.append(state.progress)
        if state.progress == 0:
            raise ValueError("cannot be handled")

    StateReader(client, on_state)
    stream = declare_stream(robot, STATE_KEY)
    assert until(lambda: stream.matching_status.matching)  # pyright: ignore[reportAttributeAccessIssue]
    for message in (numbered(state, 0), b"garbage", numbered(state, 1)):
        stream.put(message)
    assert until(lambda: heard == [0, 1]), heard
    assert "a state could not be handled" in caplog.text and "cannot be handled" in caplog.text


def test_a_reader_ends_with_its_session_or_when_it_is_closed(link):
    _, client = link
    before = set(threading.enumerate())
    StateReader(client, lambda state: None)
    closed = StateReader(client, lambda state: None)
    threads = set(threading.enumerate()) - before
    assert len(threads) == 2
    closed.close()
    closed.close()
    assert sum(thread.is_alive() for thread in threads) == 1
    client.close()
    assert until(lambda: not any(thread.is_alive() for thread in threads))


def test_a_program_that_closes_nothing_ends_as_it_wants_to(state: RobotState):
    robot, endpoint = open_listening_session("tcp/127.0.0.1:0")
    stream = declare_stream(robot, STATE_KEY)
    program = (
        "import sys\n"
        "from hw_interface.link.streams import StateReader\n"
        "from hw_interface.link.transport import open_client_session\n"
        "heard = []\n"
        "session = open_client_session(sys.argv[1])\n"
        "StateReader(session, heard.append)\n"
        "while len(heard) < 5: pass\n"
        "sys.exit(7)\n"
    )
    child = subprocess.Popen([sys.executable, "-c", program, endpoint], stderr=subprocess.PIPE, text=True)
    while child.poll() is None:
        stream.put(numbered(state, 0))
        time.sleep(0.005)
    assert child.returncode == 7 and child.stderr is not None and child.stderr.read() == ""
    robot.close()
