"""The motion that a supervisor has a player play: which part, how far it is cleared, what is written down about it."""

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from control.errors import RefusedError
from control.trajectory.on_path_stop import stop_on_path
from control.trajectory.playback import PROGRESS, RATE, Playback
from control.trajectory.samples import SAMPLE_TIME, GripperCommand, GripperEvent, Trajectory
from control.trajectory.speed_override import check_length, override_speed
from hw_interface.cell.backend import Measured
from hw_interface.cell.gate import Gate
from hw_interface.cell.motion_monitor import MonitorLimits, MotionMonitor
from hw_interface.cell.motion_record import MotionRecord
from hw_interface.cell.played_motion import refusing_plan
from hw_interface.messages.motions import MotionResult, Outcome
from hw_interface.messages.robot import Mode, Trouble
from hw_interface.panda.clearance import Clearance, clear
from hw_interface.panda.parts import Part, moving_events, parts_of

LEAD = 200  # rows (milliseconds) that are cleared as planned; a lost supervisor is noticed by their running out
RENEW = 25  # rows after which a new clearance is given
STOP_LEAD = 30  # rows from now until a stop begins: the time to compute it and hand it over
GIVE_UP = 60  # rows; the next clearance has to be there before those after the present one begin
THINK_LEAD = 400  # rows from now until a change of speed begins, which takes up to 0.3 s to compute


@dataclass(frozen=True)
class _Change:
    """A change of what is planned, on its way to the player: from row `first` on, and the clearance that says so."""

    playback: Playback
    first: int
    lead: int


class ClearedMotion:
    """A certified trajectory on its way through a player, part by part.

    Args:
        trajectory, serial, speed, gate, monitor_limits, started: As for `hw_interface.cell.played_motion.PlayedMotion`.
        number: Ordinal number of the motion, from 1.
        thinker: Where changes of speed are computed, so that clearances go on meanwhile.
        give_up: Rows before a change of speed would begin at which one that is not worked out yet is given up.

    Attributes:
        part: Index of the part that is played, or is next.
        stop_mode, stopping, trouble: As in `hw_interface.cell.robot_state_machine.PlayableMotion`.

    Raises:
        RefusedError: too_slow, or breaks_limit at that speed.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        serial: str,
        speed: float,
        gate: Gate,
        monitor_limits: MonitorLimits,
        started: float,
        number: int,
        thinker: ThreadPoolExecutor,
        give_up: int = GIVE_UP,
    ) -> None:
        with refusing_plan("too_slow"):
            check_length(len(trajectory.q) - 1, speed)
        self._playback = Playback.of(trajectory, speed)
        if speed != 1.0:
            gate.check_limits(self._playback.as_trajectory())
        self.serial, self.number = serial, number
        self.samples = len(trajectory.q)
        self.stopping = False
        self.stop_mode: Mode = "stopped"
        self.trouble: Trouble | None = None
        self.parts = parts_of(trajectory)
        self.part = 0
        self._gate = gate
        self._limits = gate.robot_limits
        self._monitor = MotionMonitor(trajectory, monitor_limits)
        self._record = MotionRecord(serial, self.samples, started)
        self._moving_events = list(moving_events(trajectory, self.parts))
        self._row = 0  # commanded last
        self._planned = self._last = 0  # last row that is cleared as planned, and at all
        self._change: _Change | None = None
        self._thinker, self._thought = thinker, None
        self._give_up = give_up
        self._think_from = 0
        self._begun = False

    # --- what is shown ------------------------------------------------------------------------------------------

    @property
    def current(self) -> Part:
        """The part that is played, or is next."""
        return self.parts[self.part]

    @property
    def first_row(self) -> int:
        """Row that the current part begins with."""
        return self._row_of(self.current.start)

    @property
    def begin(self) -> float:
        """Progress at that row."""
        return float(self._playback.clock[self.first_row, PROGRESS])

    @property
    def end_row(self) -> int:
        """Row at which the current part rests."""
        return self._row_of(self.current.stop)

    @property
    def played(self) -> int:
        """Samples of the trajectory that were commanded or passed."""
        return self._playback.sample(self._row) + 1 if self._begun else 0

    @property
    def speed(self) -> float:
        """Share of the trajectory's own speed that was commanded last."""
        return float(self._playback.clock[self._row, RATE]) if self._begun else 0.0

    def result(self, outcome: Outcome, q_d: np.ndarray, measured: Measured, now: float) -> MotionResult:
        """As `hw_interface.cell.robot_state_machine.PlayableMotion.result`."""
        return self._record.result(outcome, self.trouble, self.played, q_d, measured, self.speed, now)

    # --- what is seen -------------------------------------------------------------------------------------------

    def observe(self, row: int, q_d: np.ndarray, measured: Measured, tracking_error: float) -> Trouble | None:
        """A millisecond in which a row was commanded; why to stop now, or None.

        Args:
            row: That was commanded; -1 while none is.
            q_d: In [rad], shape (7,).
            measured: What the robot measures.
            tracking_error: Largest joint difference between the two in [rad].
        """
        if row >= 0:
            self._row, self._begun = max(self._row, row), True
        self._record.observe(q_d, measured, tracking_error, self.speed)
        if self.stopping:
            return None
        return self._monitor.check(self._playback.sample(self._row), measured, tracking_error)

    def due_events(self) -> list[GripperCommand]:
        """Gripper commands that have come due while the arm moves; each is given once."""
        due = []
        while self._moving_events and self._playback.sample(self._row) * SAMPLE_TIME >= self._moving_events[0].time:
            due.append(self._moving_events.pop(0).command)
        return due if not self.stopping else []

    def gripping(self, elapsed: int, measured: Measured, tracking_error: float) -> Trouble | None:
        """A millisecond of the dwell at the end of the current part, so many after its command.

        `waiting` tells afterwards whether the gripper needs longer.
        """
        event = self.current.gripper
        assert event is not None
        sample = self.current.stop + min(elapsed, round(event.dwell / SAMPLE_TIME))
        return self._monitor.check(sample, measured, tracking_error)

    @property
    def waiting(self) -> bool:
        """Whether the gripper needs longer than its dwell."""
        return self._monitor.waiting

    # --- what is cleared ----------------------------------------------------------------------------------------

    def begin_part(self) -> Clearance:
        """The first clearance of the current part.

        Raises:
            RefusedError: no_clearance.
        """
        first = self.first_row
        self._row, self._begun = first, True
        return self._take(clear(self._playback, first + 1, LEAD, self.end_row, self.current.stop, self._limits))

    def next_clearance(self) -> Clearance | None:
        """What to clear now: a change that is due, or the next stretch; None when nothing is needed yet."""
        if self._change is not None:
            change, self._change = self._change, None
            if change.first > self._row + 2:
                return self._commit(change)
            self._plan_stop(2 * change.lead)  # too late for that row: begin a little further on
            return self.next_clearance() if self._change is not None else None
        if self.stopping:
            return None
        limit = self._think_from - 1 if self._thought is not None else self.end_row
        reach = min(self._row + LEAD, limit, self.end_row)
        if reach <= self._planned or (reach < self.end_row and reach < self._planned + RENEW):
            return None
        first = self._planned + 1
        return self._take(
            clear(self._playback, first, reach - first + 1, self.end_row, self.current.stop, self._limits)
        )

    def refused(self) -> None:
        """The player refused the last clearance because it came too late: what was cleared before brings it to rest."""
        if self.stopping:
            self._plan_stop(2 * STOP_LEAD)

    def stop(self) -> None:
        """Come to rest on the path as soon as may be."""
        self._thought = None
        self._plan_stop(STOP_LEAD)

    def change_speed(self, speed: float, gate: Gate) -> None:
        """Play the rest at another share of its own speed, beginning in about half a second.

        What is found wrong with it only while it is computed leaves the speed as it was.

        Args:
            speed: Above 0 and at most 1.
            gate: Limits to hold the result against before it is played.

        Raises:
            RefusedError: busy (it is being stopped, or the speed is being changed) or too_slow.
        """
        if self.stopping:
            raise RefusedError("busy", "the robot is stopping; set the speed when it rests")
        if self._thought is not None:
            raise RefusedError("busy", "another change of speed is being worked out; ask again in half a second")
        with refusing_plan("too_slow"):
            check_length(self.samples - self.played, speed, self._row)
        playback, index = self._playback, self._row + THINK_LEAD
        if index >= self.end_row:
            index = self.end_row  # at rest there, so the rest of the motion is simply slower
        self._think_from = index + 1

        def think() -> Playback:
            changed = override_speed(playback, index, speed, gate.playing_limits, gate.torque)
            gate.check_limits(changed.as_trajectory())
            return changed

        self._thought = self._thinker.submit(think)

    def thought(self) -> str | None:
        """Take up a change of speed that was worked out; why it cannot be made, or None."""
        thought: Future[Playback] | None = self._thought
        if thought is None:
            return None
        if not thought.done():
            if self._row + self._give_up < self._think_from:
                return None
            self._thought = None  # else the arm would come to rest for want of a clearance
            return "it was not worked out in time; ask again"
        self._thought = None
        if (error := thought.exception()) is not None:
            return str(error)
        if self._row + 2 >= self._think_from:
            return "it was not worked out in time; ask again"
        self._playback = thought.result()
        return None

    def next_part(self) -> bool:
        """Go on to the next part; False after the last one."""
        event = self.current.gripper
        if event is not None:
            self._row = max(self._row, self._row_of(min(self.samples - 1, _over(event))))
        self.part += 1
        return self.part < len(self.parts)

    def _take(self, clearance: Clearance) -> Clearance:
        self._planned, self._last = clearance.planned, clearance.last
        return clearance

    def _commit(self, change: _Change) -> Clearance:
        self._playback = change.playback
        end = len(change.playback.q) - 1
        return self._take(
            clear(change.playback, change.first, end - change.first + 1, end, self.current.stop, self._limits)
        )

    def _plan_stop(self, lead: int) -> None:
        index = min(self._row + lead, self._planned)
        if index + 1 > self._last or index <= self._row:
            return  # what is cleared already brings the arm to rest no later
        stop = stop_on_path(self._playback, index, self._limits)
        if len(stop.q) - 1 < min(self._last, self.end_row):
            self._change = _Change(stop, index + 1, lead)

    def _row_of(self, sample: int) -> int:
        progress = self._playback.clock[:, PROGRESS]
        return int(min(np.searchsorted(progress, sample - 1e-9), len(progress) - 1))


def _over(event: GripperEvent) -> int:
    return round((event.time + event.dwell) / SAMPLE_TIME)
