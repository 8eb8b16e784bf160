"""The loop of a robot process: tick the driver at the asked pace, answer in between, end when told or orphaned."""

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from control.errors import ConfigError
from control.trajectory.samples import SAMPLE_TIME
from hw_interface.cell.driver import Driver
from hw_interface.cell.node import STATE_RATE, RobotNode
from hw_interface.cell.robot_state_machine import RobotStateMachine
from hw_interface.link.memory import keep_memory
from hw_interface.link.security import LinkSecurity
from perception.frames import RgbdFrame
from perception.ground_truth import CellTruth, FrameTruth
from replan_base.interruption import ending_signals

BURST = 0.005  # [s] of robot time between two looks at the inbox while moving
IDLE_BURST = 0.015  # [s]; at rest a coarser beat keeps the idle load low
MOST_LATE = 0.05  # [s] of wall time that are caught up after a delay
# [s]; a loop that stood still for so long (a suspended process) must not go on with a motion, unless it simulates: then
# nothing has moved meanwhile.
FROZEN_AFTER = 1.0
PARENT_CHECK = 0.25  # [s]
FAREWELL_TIME = 0.3  # [s]
END_STOP_TIME = 3.0  # [s] of robot time that a stop may take when the process is told to end in a motion


class Leash:
    """Tells when to end: SIGTERM, SIGINT, SIGHUP, or the death of the parent process.

    Args:
        parent_pid: Process to end with, or None.
    """

    def __init__(self, parent_pid: int | None = None) -> None:
        self._told = threading.Event()
        self._parent = parent_pid
        self._is_child = parent_pid is not None and os.getppid() == parent_pid
        self._next_check = 0.0

    @contextmanager
    def signals(self) -> Iterator[None]:
        """While inside, the signals end the loop instead of the process (main thread only)."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {s: signal.signal(s, lambda *_: self._told.set()) for s in ending_signals()}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def end(self) -> None:
        """End the loop (callable from any thread)."""
        self._told.set()

    def ended(self) -> bool:
        """Whether to end now."""
        now = time.monotonic()
        if self._parent is not None and now >= self._next_check:
            self._next_check = now + PARENT_CHECK
            if self._parent_gone():
                self._told.set()
        return self._told.is_set()

    def _parent_gone(self) -> bool:
        assert self._parent is not None
        if self._is_child:
            return os.getppid() != self._parent  # an orphan is adopted by another process
        try:
            os.kill(self._parent, 0)
        except ProcessLookupError:
            return True
        except PermissionError:
            pass
        return False


def serve_robot(
    driver: Driver,
    cameras: tuple[str, ...],
    take_frame: Callable[[str], RgbdFrame],
    *,
    endpoint: str,
    speed: float,
    leash: Leash,
    truth: Callable[[], CellTruth] | None = None,
    frame_truth: Callable[[str], FrameTruth] | None = None,
    security: LinkSecurity | None = None,
    connect: bool = False,
    state_rate: float = STATE_RATE,
    simulated: bool = False,
) -> None:
    """Offer a robot and its cameras at an endpoint, print the ready line, and run until the leash ends it.

    Args:
        driver, cameras, take_frame, endpoint, truth, frame_truth, security, connect, state_rate, simulated: As in
            `RobotNode`.
        speed: As in `run_loop`.
        leash: When to end.

    Raises:
        ConfigError: Endpoint, port or speed are not valid.
        RobotGoneError: There is no router to join.
    """
    keep_memory()
    with leash.signals():
        node = RobotNode(
            driver,
            cameras,
            take_frame,
            endpoint,
            truth=truth,
            frame_truth=frame_truth,
            security=security,
            connect=connect,
            state_rate=state_rate,
            simulated=simulated,
        )
        try:
            announce(node, driver)
            run_loop(driver, node, leash, speed)
        finally:
            node.close()


def announce(node: RobotNode, driver: RobotStateMachine) -> None:
    """Print the one line that tells a parent process that the robot is ready: JSON with endpoint and pid."""
    line = {"ready": True, "endpoint": node.endpoint, "pid": os.getpid(), "cell": driver.cell, "epoch": driver.epoch}
    print(json.dumps(line), file=sys.stdout, flush=True)


def run_loop(driver: Driver, node: RobotNode, leash: Leash, speed: float) -> None:
    """Tick and serve until the leash ends it; a motion is brought to rest first.

    A simulated robot's time stands still while its process does, and while the operator of its motion is silent.

    Args:
        speed: Robot time per wall time while moving; 0 means as fast as possible. At rest robot time is wall time.

    Raises:
        ConfigError: `speed` is negative.
    """
    if not speed >= 0.0:
        raise ConfigError(f"speed {speed:g} is not valid; it must be 0 (as fast as possible) or above (1 is real time)")
    clock = time.monotonic
    due = clock()  # wall time at which the next burst begins
    moving = False
    stall = 0.0  # longest that the loop stood still without a reason since the last burst
    # Time is accounted for from mark to mark without a gap, so a process may be suspended anywhere and it shows.
    mark, used = clock(), time.process_time()
    while not leash.ended():
        wait = max(0.0, due - clock())
        spent = node.serve(wait)
        due += spent  # robot time stands still while a picture is taken
        now, cpu = clock(), time.process_time()
        # An answer is a reason to stand still only as far as it was worked on: a suspended process works on nothing.
        stall = max(stall, now - mark - wait - min(spent, cpu - used))
        mark, used = now, cpu
        if node.waiting:
            due, stall = now + BURST, 0.0
            continue
        if driver.moving and not moving:
            due = now  # a motion has just been accepted: begin now
        elif now < due:
            continue
        if stall > FROZEN_AFTER and driver.moving and not node.simulated:
            driver.reflex("frozen", f"the robot process stood still for {stall:.1f} s in a motion")
        stall = 0.0
        moving = driver.moving
        # Whoever asks for more states also gets fresher ones.
        burst = max(min(BURST if moving else IDLE_BURST, node.state_period), SAMPLE_TIME)
        for _ in range(round(burst / SAMPLE_TIME)):
            driver.tick()
        pace = speed if moving else 1.0
        # A loop that is too slow for the pace runs late; it never hurries to catch up for more than a moment.
        due = max(due + burst / pace, clock() - MOST_LATE) if pace > 0.0 else clock()
    if driver.moving:
        _rest_and_tell(driver, node)


def _rest_and_tell(driver: Driver, node: RobotNode) -> None:
    """Bring the arm to rest, then stay long enough that whoever waits for the motion learns what became of it."""
    driver.stop()
    for _ in range(round(END_STOP_TIME / SAMPLE_TIME)):
        if not driver.moving:
            break
        driver.tick()
    until = time.monotonic() + FAREWELL_TIME
    while (left := until - time.monotonic()) > 0.0:
        node.serve(min(left, node.state_period))
