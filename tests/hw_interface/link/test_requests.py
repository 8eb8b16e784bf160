"""Questions and answers over a link: the first reply, why there is none, and nothing bulky lost on the way."""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import pytest
import zenoh

from control.errors import RefusedError, RobotGoneError
from hw_interface.link.requests import Outbox, answer, ask
from hw_interface.link.transport import open_client_session, open_robot_session
from hw_interface.messages.robot import AcknowledgeRequest, Refusal, StopRequest
from hw_interface.own_time import OwnTime
from tests.support.load.freezing import freeze, wake
from tests.support.waiting import until

KEY, NEWS = "cell/question", "cell/news"
LARGE = 30_000_000  # bytes; several times what sockets and queues hold, less than the largest message
READER = """
import os, sys, time
from hw_interface.link.transport import open_client_session
session = open_client_session(sys.argv[1])
subscriber = session.declare_subscriber(sys.argv[2], lambda s: print(len(s.payload.to_bytes()), flush=True))
print("ready", flush=True)
time.sleep(30.0)
os._exit(0)
"""


@pytest.fixture
def robot() -> Iterator[tuple[zenoh.Session, str]]:
    session, endpoint = open_robot_session("tcp/127.0.0.1:0")
    yield session, endpoint
    session.close()


@pytest.fixture
def client(robot: tuple[zenoh.Session, str]) -> Iterator[zenoh.Session]:
    session = open_client_session(robot[1])
    yield session
    session.close()


def question(session: zenoh.Session, timeout: float = 5.0) -> StopRequest:
    return ask(session, KEY, AcknowledgeRequest(), StopRequest, timeout)


def test_the_first_reply_is_the_answer_though_the_other_side_still_holds_the_query(robot, client):
    held = []

    def reply_and_hold(query: zenoh.Query) -> None:
        answer(query, StopRequest(reason="the answer"))
        held.append(query)  # as a node does that goes on with what was asked for, for instance publishes the motion

    queryable = robot[0].declare_queryable(KEY, reply_and_hold)
    # Were the reply held back until the query is let go, none would come in time.
    assert question(client).reason == "the answer"
    queryable.undeclare()


def test_a_refusal_is_an_answer_too(robot, client):
    queryable = robot[0].declare_queryable(KEY, lambda q: answer(q, Refusal(code="busy", reason="not now")))
    with pytest.raises(RefusedError, match="not now"):
        question(client)
    queryable.undeclare()


def test_nobody_who_answers_is_said_at_once(client):
    with pytest.raises(
        RobotGoneError, match=r"did not answer 'cell/question': after 0\.\d\d s there was nobody who would"
    ):
        question(client, 60.0)


def test_a_question_that_is_not_answered_says_how_long_it_was_waited_for(robot, client):
    held = []
    queryable = robot[0].declare_queryable(KEY, held.append)
    with pytest.raises(
        RobotGoneError, match=r"did not answer 'cell/question': nothing came in 0\.3 s; it is frozen or"
    ):
        question(client, 0.3)
    queryable.undeclare()


def test_a_link_that_breaks_under_a_question_is_said(robot, client):
    asked = threading.Event()
    queryable = robot[0].declare_queryable(KEY, lambda query: asked.set() or held.append(query))
    held: list[zenoh.Query] = []
    threading.Thread(target=lambda: asked.wait() and robot[0].close()).start()
    with pytest.raises(
        RobotGoneError, match=r"did not answer 'cell/question': after \d+\.\d\d s the link to it was lost; see"
    ):
        question(client, 60.0)
    del queryable


@pytest.fixture
def reader(robot) -> Iterator["subprocess.Popen[str]"]:
    """A process that hears what is published under `NEWS` and prints how many bytes it has."""
    with subprocess.Popen([sys.executable, "-c", READER, robot[1], NEWS], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        yield process
        process.kill()


def test_a_large_message_for_a_reader_that_stands_still_for_a_while_arrives_and_holds_up_nobody(robot, reader):
    publisher = robot[0].declare_publisher(NEWS)
    assert until(lambda: publisher.matching_status.matching)
    outbox = Outbox(robot[0])
    freeze(reader.pid)
    outbox.publish(NEWS, bytes(LARGE))
    # Whoever publishes goes on while the link has no room: else nobody would wake the reader here.
    outbox.publish(NEWS, b"the next one")
    time.sleep(0.5)  # ten times as long as a message that may be dropped waits for room
    wake(reader.pid)
    assert [reader.stdout.readline(), reader.stdout.readline()] == [f"{LARGE}\n", "12\n"]
    outbox.close()


def test_time_in_which_a_process_stood_still_does_not_count_as_waiting():
    now = [100.0]
    waited = OwnTime(lambda: now[0], longest=0.2)
    for _ in range(10):
        now[0] += 0.05
        waited.look()
    assert waited.counted == pytest.approx(0.5) and waited.stood_still == 0.0
    now[0] += 60.0
    assert waited.look() == pytest.approx(0.7) and waited.stood_still == pytest.approx(59.8)
    waited.restart()
    assert waited.look() == 0.0 and waited.stood_still == 0.0
