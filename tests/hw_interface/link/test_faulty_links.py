"""Motions over links that delay, stall, part, are cut and flip bits: played once as they were meant, or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager

import msgpack
import numpy as np
import pytest

from benchmarks.robot_side.faulty_link import Faults, FaultyLink
from benchmarks.robot_side.perfect_robot import certificate, from_here
from control.errors import RefusedError, RobotGoneError, StackError
from control.safety.certificate import Certificate
from control.trajectory.samples import Trajectory
from hw_interface.cell.client import CellClient, MotionProgress
from hw_interface.cell.operator_lease import Operator
from hw_interface.cell.process import SimProcess
from hw_interface.errors import MessageError
from hw_interface.link import requests, transport
from hw_interface.messages.motions import TrajectoryRequest
from hw_interface.messages.robot import Accepted, CellInfo, InfoRequest, Refusal
from hw_interface.messages.wire import PROTOCOL_VERSION, decode, encode, seal
from tests.support.robot_side.hw_support import idle_client, robot_process, robot_thread
from tests.support.waiting import until

pytestmark = pytest.mark.real_time


@pytest.fixture(scope="module")
def robot() -> Iterator[SimProcess]:
    """A robot process without physics."""
    with robot_process("perfect", speed=1.0) as process:
        yield process


@contextmanager
def link(robot: SimProcess, **faults: float) -> Iterator[FaultyLink]:
    """A faulty way to the robot; afterwards the robot is acknowledged over the good one."""
    with FaultyLink(robot.endpoint, 7, Faults(**faults)) as faulty:
        yield faulty
    with idle_client(robot.endpoint):
        pass


def outcome(client: CellClient, motion: Trajectory, right: Certificate) -> str:
    """The outcome of a motion, or the code or kind of what was raised."""
    try:
        return client.execute(motion, right).reason
    except RefusedError as error:
        return error.code
    except StackError as error:
        return type(error).__name__


def test_a_motion_over_a_link_with_100_ms_of_round_trip_is_played_once_and_to_its_end(robot: SimProcess):
    with link(robot, delay=0.05) as late, CellClient.connect(late.endpoint) as client:
        motion = from_here(client, 1.0, 0.05)
        right = certificate(motion)
        report = client.execute(motion, right)
        assert report.completed and report.played == len(motion.q)
        with pytest.raises(RefusedError) as again:
            client.execute(motion, right)
        assert again.value.code == "certificate_used"
        assert late.connections == 1, "lateness alone breaks no link"


def test_lost_packets_delay_a_motion_but_change_nothing_about_it(robot: SimProcess):
    # A tenth of all chunks come 0.15 s late with all behind them; an operator may be silent for longer than one takes.
    with link(robot, stalls=0.1, stall=0.15) as lossy, CellClient.connect(lossy.endpoint) as client:
        for radians in (0.05, -0.05, 0.03):
            motion = from_here(client, 0.5, radians)
            assert outcome(client, motion, certificate(motion)) == "completed"
        assert lossy.connections == 1


def test_a_parted_link_brings_the_arm_to_rest_and_a_healed_one_needs_a_person(robot: SimProcess):
    with (
        link(robot) as parted,
        CellClient.connect(robot.endpoint) as witness,
        CellClient.connect(parted.endpoint) as client,
    ):
        motion = from_here(client, 4.0, 0.3)
        pulled: list[int] = []

        def pull_the_cable(progress: MotionProgress) -> None:
            if progress.played > 500 and not pulled:
                parted.part()
                pulled.append(witness.state().progress)

        with pytest.raises(
            RobotGoneError, match=r"has not reported for .* s: it is frozen or hangs, or the link to it"
        ):
            client.execute(motion, certificate(motion), pull_the_cable)
        assert until(lambda: witness.state().mode == "reflex"), "without its operator the robot rests"
        error = witness.state().last_error
        assert error is not None and error.code == "operator_gone"
        # Half a second without a beat, then the way to rest; the rest is room for a busy machine.
        assert witness.state().progress - pulled[0] < 1200
        rest = np.array(witness.state().q_d)
        assert np.abs(motion.q - rest).max(axis=1).min() < 1e-3, "on its path"
        parted.heal()
        with pytest.raises(RefusedError, match="acknowledge"):
            client.execute(motion, certificate(motion))
        assert np.array_equal(witness.state().q_d, rest), "and nothing goes on by itself"
        assert parted.connections == 1, "silence of a few seconds tears no link"
        witness.acknowledge()
        again = from_here(client, 0.5, 0.02)
        assert client.execute(again, certificate(again)).completed


def test_a_robot_that_loses_its_router_brings_the_arm_to_rest():
    session, router = transport.open_listening_session("tcp/127.0.0.1:0")
    try:
        with (
            FaultyLink(router, 7) as faulty,
            robot_thread(faulty.endpoint, connect=True),
            CellClient.connect(router) as client,
        ):
            motion = from_here(client, 3.0, 0.3)

            def pull_the_cable(progress: MotionProgress) -> None:
                if progress.played > 300:
                    faulty.part()

            with pytest.raises(RobotGoneError):
                client.execute(motion, certificate(motion), pull_the_cable)
            faulty.heal()
            state = client.state()
            assert state.mode == "reflex" and state.last_error is not None and state.progress < state.samples
            assert state.last_error.code == "operator_gone"
    finally:
        session.close()


def test_a_cut_while_a_motion_is_sent_leaves_it_played_once_or_not_at_all(robot: SimProcess):
    with link(robot, delay=0.05) as cut, CellClient.connect(robot.endpoint) as witness:
        for _ in range(3):
            before = np.array(witness.state().q_d)
            with CellClient.connect(cut.endpoint, timeout=1.0) as client:
                motion = from_here(witness, 0.5, 0.02)
                right = certificate(motion)
                operator = Operator(client._session)
                request = TrajectoryRequest.of(motion, right, client.info.epoch, operator.identity)
                replies = client._session.get(transport.TRAJECTORY_KEY, payload=encode(request), timeout=1.0)
                cut.cut()
                answers = list(replies)
                operator.close()
            accepted = [decode(r.ok.payload.to_bytes(), Accepted).serial for r in answers if r.ok is not None]
            assert accepted in ([], [right.serial])
            assert until(lambda: witness.state().mode not in ("moving", "stopping"))
            state = witness.state()
            if state.motion_serial != right.serial:
                assert np.array_equal(state.q_d, before), "not at all"
            if state.mode != "idle":
                witness.acknowledge()


def test_the_same_request_sent_twice_at_once_is_played_once(robot: SimProcess):
    with idle_client(robot.endpoint) as client:
        motion = from_here(client, 0.5, 0.05)
        operator = Operator(client._session)
        request = encode(TrajectoryRequest.of(motion, certificate(motion), client.info.epoch, operator.identity))
        both = [client._session.get(transport.TRAJECTORY_KEY, payload=request, timeout=5.0) for _ in range(2)]
        replies = [reply for channel in both for reply in channel]
        operator_codes = [decode(r.err.payload.to_bytes(), Refusal).code for r in replies if r.err is not None]
        assert len(replies) == 2 and operator_codes in (["busy"], ["certificate_used"])
        assert until(lambda: client.state().mode == "idle" and client.state().progress == len(motion.q))
        (late,) = list(client._session.get(transport.TRAJECTORY_KEY, payload=request, timeout=5.0))
        assert late.err is not None and decode(late.err.payload.to_bytes(), Refusal).code == "certificate_used"
        operator.close()


def test_another_protocol_version_is_told_on_both_sides(robot: SimProcess):
    session = transport.open_client_session(robot.endpoint)
    try:
        body = msgpack.packb({})
        assert body is not None
        newer = seal("info_request", body, PROTOCOL_VERSION + 1)
        (reply,) = list(session.get(transport.INFO_KEY, payload=newer, timeout=5.0))
        assert reply.err is not None
        refusal = decode(reply.err.payload.to_bytes(), Refusal)
        assert refusal.code == "bad_message" and "install the same release on both sides" in refusal.reason
        # A client of ours in front of a robot of another version.
        refused = seal("refusal", body, PROTOCOL_VERSION + 1)
        queryable = session.declare_queryable("cell/newer", lambda query: query.reply_err(refused))
        with pytest.raises(MessageError, match=rf"version {PROTOCOL_VERSION + 1} is not understood"):
            requests.ask(session, "cell/newer", InfoRequest(), CellInfo, 5.0)
        queryable.undeclare()
    finally:
        session.close()
