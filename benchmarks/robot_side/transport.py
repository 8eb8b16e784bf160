"""What the wire between processes gives: how soon a motion is accepted, how late states are, pictures a second.

Each part runs on the machine as it is and again while as many processes as it has cores compute. Robot, publisher and
camera are processes of their own, as they are in use; everything stays on this machine.

    trajectories  an 8 s motion with its certificate. "Delivered" is from the call until it is refused because it is
                  meant for another run of the robot process, which is looked at as soon as it is decoded: encoding,
                  transport, check sum, decoding and the way back. "Accepted" is from the call to the robot's
                  acceptance, so hashing and the gate's checks of all samples as well, by a robot that leaves torques
                  and the hand's speeds to the certificate and by one that does not (as the cells' robots)
    states        from the stamp in the publishing process to the client's callback, decoded; sequence numbers tell what
                  is lost. Also while pictures pass over the same link, which states must overtake
    pictures      colour and depth, asked for one after the other, from the call to the RgbdFrame

    python -m benchmarks.robot_side.transport [--seconds 60] [--rate 1000] [--deliveries 30] [--pictures 60] [--json]
"""

import argparse
import contextlib
import json
import multiprocessing
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.robot_side.perfect_process import perfect_process
from benchmarks.robot_side.perfect_robot import certificate, from_here, perfect_driver
from control.errors import RefusedError, RobotGoneError
from control.safety.certificate import Certificate
from control.trajectory.samples import Trajectory
from hw_interface.cell.client import CellClient
from hw_interface.cell.operator_lease import Operator
from hw_interface.link.requests import answer, ask, read_request, refusing
from hw_interface.link.streams import StateReader, declare_stream
from hw_interface.link.transport import FRAME_KEY, STATE_KEY, TRAJECTORY_KEY, open_client_session, open_robot_session
from hw_interface.messages.frames import FrameMessage
from hw_interface.messages.motions import TrajectoryRequest
from hw_interface.messages.robot import Accepted, FrameRequest, RobotState
from hw_interface.messages.wire import encode
from perception.frames import CameraIntrinsics, RgbdFrame

WIDTH, HEIGHT = 1280, 720
LENGTH = 8.0  # [s] of motion
SETTLE = 0.5  # [s] for a new process to become quiet


@dataclass(frozen=True)
class Row:
    """One figure with its spread.

    Attributes:
        what, machine: What was measured, and whether the machine was "idle" or "loaded".
        count: Of what was measured.
        lost: States that never came; motions that were never answered.
        p50, p99, most: In [ms].
        rate: A second, of what was measured.
    """

    what: str
    machine: str
    count: int
    lost: int
    p50: float
    p99: float
    most: float
    rate: float


def row(what: str, machine: str, seconds: list[float], rate: float, lost: int = 0) -> Row:
    """The row of these times in [s]."""
    p50, p99, most = (float(x) for x in np.percentile(np.array(seconds) * 1e3, [50, 99, 100]).round(3))
    return Row(what, machine, len(seconds), lost, p50, p99, most, round(rate, 1))


@contextmanager
def load(processes: int) -> Iterator[None]:
    """So many processes that compute, ended afterwards."""
    command = [sys.executable, "-c", "while True: pass"]
    busy = [subprocess.Popen(command) for _ in range(processes)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def until(condition: Callable[[], bool], seconds: float = 5.0) -> bool:
    """Whether the condition became true in time, in [s]."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.01)
    return False


def deliveries(count: int, machine: str, kind: str, checks: str) -> list[Row]:
    """Motions delivered to, and accepted by, a robot process without physics, which plays them as fast as it goes.

    Args:
        kind: Of `perfect_process`.
        checks: What its gate holds samples against, for the table.
    """
    accepted, lost = [], 0
    with perfect_process(kind, speed=0.0) as robot, CellClient.connect(robot.endpoint) as client:
        session, info = open_client_session(robot.endpoint), client.info
        robots = {"profile": info.profile, "firmware": info.firmware, "limits_hash": info.limits_hash}
        with contextlib.closing(session), Operator(session) as operator:

            def send(motion: Trajectory, right: Certificate, epoch: str) -> float:
                begun = time.monotonic()
                request = TrajectoryRequest.of(motion, right, epoch, operator.identity)
                try:
                    ask(session, TRAJECTORY_KEY, request, Accepted, 5.0)
                except RefusedError as error:
                    if error.code != "wrong_epoch" or epoch == info.epoch:
                        raise
                return time.monotonic() - begun

            motion = from_here(client, LENGTH, 0.2)
            delivered = [send(motion, certificate(motion, **robots), "another") for _ in range(count)]
            for i in range(count):
                motion = from_here(client, LENGTH, 0.2 if i % 2 else -0.2)
                right = certificate(motion, **robots)
                try:
                    accepted.append(send(motion, right, info.epoch))
                except RobotGoneError:
                    lost += 1  # a machine so busy that the transport's threads stand still for longer than the lease
                assert until(lambda: client.state().mode not in ("moving", "stopping"), 30.0)
                if client.state().mode != "idle":
                    client.acknowledge()
    return [
        row(f"motion of {LENGTH:g} s {what}", machine, times, 1.0 / float(np.mean(times)), lost)
        for what, times in (("delivered", delivered), (f"accepted: {checks}", accepted))
    ]


def publish_states(rate: float, seconds: float, pipe) -> None:
    """The publishing process: states with a number in `progress` and monotonic time in `stamp`; pictures on request."""
    session, endpoint = open_robot_session("tcp/127.0.0.1:0")
    stream = declare_stream(session, STATE_KEY)
    picture = camera_picture()
    session.declare_queryable(f"{FRAME_KEY}/camera", lambda query: show(query, picture))
    state = perfect_driver()[0].state()
    pipe.send(endpoint)
    pipe.recv()
    begun = time.monotonic()
    for number in range(round(rate * seconds)):
        time.sleep(max(0.0, begun + number / rate - time.monotonic()))
        stream.put(encode(state.model_copy(update={"stamp": time.monotonic(), "progress": number})))
    pipe.send("done")
    pipe.recv()
    stream.undeclare()
    session.close()


def show(query, picture: RgbdFrame) -> None:
    """Answer a request for a picture."""
    with query, refusing(query):
        read_request(query, FrameRequest)
        answer(query, FrameMessage.of(picture))


def camera_picture() -> RgbdFrame:
    """A picture of noise, which nothing could compress."""
    rng = np.random.default_rng(0)
    return RgbdFrame(
        rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8),
        rng.random((HEIGHT, WIDTH), dtype=np.float32) + 0.5,
        CameraIntrinsics(WIDTH, HEIGHT, 900.0, 900.0, WIDTH / 2, HEIGHT / 2),
        np.eye(4),
        time.time(),
        "camera",
    )


@contextmanager
def publisher(rate: float, seconds: float) -> Iterator[tuple]:
    """The publishing process: its pipe and its endpoint."""
    context = multiprocessing.get_context("spawn")  # a fork would copy the transport's threads' locks
    pipe, end = context.Pipe()
    process = context.Process(target=publish_states, args=(rate, seconds, end))
    process.start()
    try:
        yield pipe, pipe.recv()
        pipe.send("close")
        process.join(5.0)
    finally:
        process.kill()


def states(rate: float, seconds: float, machine: str, with_pictures: bool) -> Row:
    """States from one process to another."""
    seen: list[tuple[int, float]] = []

    def on_state(state: RobotState) -> None:
        seen.append((state.progress, time.monotonic() - state.stamp))

    with publisher(rate, seconds) as (pipe, endpoint):
        session = open_client_session(endpoint)
        with contextlib.closing(session):
            StateReader(session, on_state)
            time.sleep(SETTLE)
            ended = threading.Event()
            pipe.send("go")
            looking = threading.Thread(target=look_on, args=(session, ended))
            if with_pictures:
                looking.start()
            pipe.recv()
            ended.set()
            if with_pictures:
                looking.join()
            time.sleep(SETTLE)
    numbers = [number for number, _ in seen]
    assert numbers == sorted(set(numbers)), "each at most once and in order"
    what = f"state at {rate:g} a second" + (", pictures on the same link" if with_pictures else "")
    return row(what, machine, [late for _, late in seen], len(seen) / seconds, round(rate * seconds) - len(seen))


def look_on(session, ended: threading.Event) -> None:
    """Ask for raw pictures until the event is set."""
    while not ended.is_set():
        list(session.get(f"{FRAME_KEY}/camera", payload=encode(FrameRequest()), timeout=10.0))


def pictures(count: int, machine: str) -> Row:
    """Pictures asked for one after the other."""
    times = []
    with publisher(1.0, 1.0) as (pipe, endpoint):
        session = open_client_session(endpoint)
        with contextlib.closing(session):
            pipe.send("go")
            pipe.recv()
            for _ in range(count):
                begun = time.monotonic()
                frame = ask(session, f"{FRAME_KEY}/camera", FrameRequest(), FrameMessage, 10.0).frame()
                times.append(time.monotonic() - begun)
                assert frame.colour.shape == (HEIGHT, WIDTH, 3)
    return row(f"picture {WIDTH}x{HEIGHT} with depth", machine, times, 1.0 / float(np.mean(times)))


def main() -> int:
    """Measure everything and print a table, or JSON; exit code 1 when a state or a motion was lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="of states")
    parser.add_argument("--rate", type=float, default=1000.0, help="states a second")
    parser.add_argument("--deliveries", type=int, default=30, help="motions")
    parser.add_argument("--pictures", type=int, default=60, help="pictures")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    options = parser.parse_args()
    rows = []
    for machine, processes in (("idle", 0), ("loaded", os.cpu_count() or 1)):
        with load(processes):
            for part in (
                lambda machine=machine: deliveries(options.deliveries, machine, "perfect", "joints"),
                lambda machine=machine: deliveries(options.deliveries, machine, "cautious", "joints, torques, hand"),
                lambda machine=machine: [states(options.rate, options.seconds, machine, False)],
                lambda machine=machine: [states(options.rate, options.seconds / 4, machine, True)],
                lambda machine=machine: [pictures(options.pictures, machine)],
            ):
                rows += part()
                print(f"{rows[-1].machine}: {rows[-1].what}: done", file=sys.stderr, flush=True)
    if options.json:
        print(json.dumps({"cores": os.cpu_count(), "rows": [asdict(r) for r in rows]}))
    else:
        titles = f"{'p50 ms':>8} {'p99 ms':>8} {'most':>8} {'a second':>9}"
        print(f"{'':<55} {'machine':>7} {'count':>6} {'lost':>5} {titles}")
        for r in rows:
            figures = f"{r.p50:>8.2f} {r.p99:>8.2f} {r.most:>8.2f} {r.rate:>9.1f}"
            print(f"{r.what:<55} {r.machine:>7} {r.count:>6} {r.lost:>5} {figures}")
    return 1 if any(r.lost for r in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
