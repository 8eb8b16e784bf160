"""Faults to inject into a running robot side: what each does, and what has to come of it.

Every fault is injected at a random moment of a certified motion (some before it). `EXPECTED` says how the robot side
must be afterwards; what must never happen, whatever the fault, is judged by `benchmarks.robot_side.fault_judgement`.
"""

import contextlib
import os
import resource
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import zenoh

from benchmarks.robot_side.faulty_link import Faults, FaultyLink
from benchmarks.robot_side.panda_side import PandaSide, certified
from control.errors import RefusedError, StackError
from control.safety.certificate import Certificate
from control.trajectory.samples import Trajectory
from hw_interface.cell.client import CellClient
from hw_interface.cell.gate import Gate
from hw_interface.link.transport import TRAJECTORY_KEY, open_client_session
from hw_interface.messages.motions import TrajectoryRequest
from hw_interface.messages.wire import encode, seal


@dataclass
class Scene:
    """What a fault may use.

    Attributes:
        side: The robot side.
        gate: Of its cell.
        watcher: A client that only looks.
        operator_pid: Its process, where that is one of its own; else None.
        link: The link that the operator's client goes through.
        trajectory, certificate: The motion.
        rng: Random numbers of this injection.
        notes: What the fault found out, for the record.
        cleanup: To be called when the injection is over.
    """

    side: PandaSide
    gate: Gate
    watcher: CellClient
    operator_pid: int | None
    link: FaultyLink
    trajectory: Trajectory
    certificate: Certificate
    rng: np.random.Generator
    notes: dict[str, object]
    cleanup: list[Callable[[], object]]


@dataclass(frozen=True)
class Kind:
    """One kind of fault.

    Attributes:
        name: In the table.
        inject: Does it.
        expected: Outcomes that are right: "completed", "rests" (at rest and latched, or the robot side is gone),
            "refused" (what was asked in addition did nothing; the motion itself goes on).
        own_process: The operator has to be a process of its own.
        loses_supervisor: Times and departures count as those after the loss of the supervisor.
    """

    name: str
    inject: Callable[[Scene], None]
    expected: tuple[str, ...]
    own_process: bool = False
    loses_supervisor: bool = False


def _signal(child: str, number: int) -> Callable[[Scene], None]:
    def inject(scene: Scene) -> None:
        pid = scene.side.supervisor.pid if child == "supervisor" else scene.side.child(child)
        os.kill(pid, number)
        if number == signal.SIGSTOP:  # one that nobody noticed would be the next injection's fault
            scene.cleanup.append(lambda: _wake(pid))

    return inject


def _wake(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGCONT)


def _freeze_supervisor(scene: Scene) -> None:
    pid = scene.side.supervisor.pid
    os.kill(pid, signal.SIGSTOP)
    # Longer than the supervisor may stand still in a motion; a box in lockstep waits through a shorter pause.
    time.sleep(float(scene.rng.uniform(1.2, 2.5)))
    os.kill(pid, signal.SIGCONT)


def _signal_operator(number: int) -> Callable[[Scene], None]:
    def inject(scene: Scene) -> None:
        assert scene.operator_pid is not None
        os.kill(scene.operator_pid, number)

    return inject


def _box(*lines: str, off: str = "", pause: float = 0.0) -> Callable[[Scene], None]:
    """Lines for the simulated box, and one to undo them after a pause in [s]."""

    def inject(scene: Scene) -> None:
        for line in lines:
            scene.side.box.faults.send(line.format(joint=scene.rng.integers(1, 8), many=scene.rng.integers(22, 60)))
        if off:
            time.sleep(pause)
            scene.side.box.faults.send(off)

    return inject


def _link(faults: Faults) -> Callable[[Scene], None]:
    def inject(scene: Scene) -> None:
        scene.link.faults = faults
        scene.cleanup.append(lambda: setattr(scene.link, "faults", Faults()))

    return inject


def _part(seconds: float) -> Callable[[Scene], None]:
    def inject(scene: Scene) -> None:
        scene.link.part()
        time.sleep(seconds)
        scene.link.heal()

    return inject


def _cut(scene: Scene) -> None:
    scene.link.cut()


def _ask_in_addition(scene: Scene, trajectory: Trajectory, certificate: Certificate | None) -> None:
    """Another operator's motion, which must be refused."""
    with CellClient.connect(scene.side.endpoint) as other:
        try:
            other.execute(trajectory, certificate)
        except RefusedError as error:
            scene.notes["refused"] = error.code
        else:
            scene.notes["refused"] = None


def _second_planner(scene: Scene) -> None:
    _ask_in_addition(scene, scene.trajectory, certified(scene.trajectory, scene.gate))


def _duplicate(scene: Scene) -> None:
    _ask_in_addition(scene, scene.trajectory, scene.certificate)


def _clock(offset: float) -> Callable[[Scene], None]:
    """As a planner whose clock jumped by so many seconds would certify."""

    def inject(scene: Scene) -> None:
        c = certified(scene.trajectory, scene.gate)
        moved = Certificate(
            **{
                **c.__dict__,
                **{name: getattr(c, name) + offset for name in ("scene_stamp", "issued", "expires")},
            }
        )
        _ask_in_addition(scene, scene.trajectory, moved)

    return inject


def _uncertified(scene: Scene) -> None:
    _ask_in_addition(scene, scene.trajectory, None)


def _flipped_bits(scene: Scene) -> None:
    """A copy of the request with flipped bits, from a session of its own."""
    request = TrajectoryRequest.of(
        scene.trajectory, certified(scene.trajectory, scene.gate), scene.watcher.info.epoch, "somebody"
    )
    data = bytearray(encode(request))
    for bit in scene.rng.integers(0, 8 * len(data), size=3):
        data[bit // 8] ^= 1 << int(bit % 8)
    _send_raw(scene, bytes(data))


def _other_version(scene: Scene) -> None:
    _send_raw(scene, seal("trajectory_request", b"\x80", protocol=2))


def _send_raw(scene: Scene, data: bytes) -> None:
    session: zenoh.Session = open_client_session(scene.side.endpoint)
    try:
        replies = list(session.get(TRAJECTORY_KEY, payload=data, timeout=5.0))
        scene.notes["refused"] = None if any(r.ok is not None for r in replies) or not replies else "bad_message"
    finally:
        session.close()


def _full_disk(scene: Scene) -> None:
    """No file of the supervisor may grow any more."""
    pid, size = scene.side.supervisor.pid, scene.side.audit_log.stat().st_size
    before = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (size, before[1]))
    scene.cleanup.append(lambda: resource.prlimit(pid, resource.RLIMIT_FSIZE, before))
    # What has to be written down next: somebody changes the speed.
    try:
        scene.watcher.set_speed(1.0)
    except StackError as error:
        scene.notes["refused"] = str(error)


KINDS = (
    Kind("player killed", _signal("panda_player", signal.SIGKILL), ("rests",)),
    Kind("player frozen", _signal("panda_player", signal.SIGSTOP), ("rests",)),
    Kind("supervisor killed", _signal("supervisor", signal.SIGKILL), ("rests",), loses_supervisor=True),
    Kind("supervisor frozen", _freeze_supervisor, ("rests",), loses_supervisor=True),
    Kind("planner killed", _signal_operator(signal.SIGKILL), ("rests",), own_process=True),
    Kind("planner frozen", _signal_operator(signal.SIGSTOP), ("rests",), own_process=True),
    Kind("gripper process killed", _signal("panda_hand", signal.SIGKILL), ("rests",)),
    Kind("gripper process frozen", _signal("panda_hand", signal.SIGSTOP), ("rests", "completed")),
    Kind(
        "gripper not answering", _box("gripper_silent on", off="gripper_silent off", pause=4.0), ("rests", "completed")
    ),
    Kind("user stop", _box("user_stop on"), ("rests",)),
    Kind("reflex", _box("reflex joint_reflex"), ("rests",)),
    Kind("push", _box("push {joint} 70 0.3"), ("rests",)),
    Kind("control box frozen", _box("freeze on", off="freeze off", pause=3.0), ("rests",)),
    Kind("few packets lost", _box("drop 5"), ("completed",)),
    Kind("many packets lost", _box("drop {many}"), ("rests",)),
    Kind("link 200 ms late", _link(Faults(delay=0.2)), ("completed", "rests")),
    Kind("link loses packets", _link(Faults(stalls=0.1, stall=0.2)), ("completed", "rests")),
    # A box in lockstep is faster than the clock: a motion may end before the operator has been silent for a second.
    Kind("link parted for 2 s", _part(2.0), ("completed", "rests")),
    Kind("link parted for 0.1 s", _part(0.1), ("completed", "rests")),
    Kind("link cut", _cut, ("rests",)),
    Kind("second planner", _second_planner, ("refused",)),
    Kind("duplicated trajectory", _duplicate, ("refused",)),
    Kind("no certificate", _uncertified, ("refused",)),
    Kind("clock an hour ahead", _clock(3600.0), ("refused",)),
    Kind("clock an hour behind", _clock(-3600.0), ("refused",)),
    Kind("flipped bits", _flipped_bits, ("refused",)),
    Kind("other version", _other_version, ("refused",)),
    Kind("disk full", _full_disk, ("rests",)),
)
