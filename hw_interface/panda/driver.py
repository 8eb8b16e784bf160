"""The supervisor's driver of a real Panda: owns the right to move, and gives it to the player in small pieces.

    supervisor (this process)                      player (a process of its own)
      gate, latch, watch, audit                      gate again, certified samples, libfranka at 1 kHz
      clearance: progress until a rest   ───────▶    takes it when it keeps every limit
      measurements of every millisecond  ◀───────    one a call of libfranka

Whatever dies or freezes, the arm comes to rest on its path: the player when no new clearance comes, the control box
when the player's commands stay away. Afterwards the robot is latched; only an acknowledgement, by a person, recovers
the control box or starts a new player.
"""

import logging
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import numpy as np

from control.errors import RefusedError, StackError
from control.safety.certificate import Certificate
from control.trajectory.samples import SAMPLE_TIME, Trajectory
from hw_interface.cell.backend import Measured
from hw_interface.cell.gate import Gate
from hw_interface.cell.motion_monitor import MonitorLimits
from hw_interface.cell.robot_state_machine import RobotStateMachine, internal_trouble
from hw_interface.errors import MessageError
from hw_interface.messages.motions import TrajectoryRequest
from hw_interface.messages.robot import Refusal, Trouble
from hw_interface.panda.cleared_motion import GIVE_UP, ClearedMotion
from hw_interface.panda.hand import Hand
from hw_interface.panda.link import BeginPart, LoadMotion, MotionLoaded, PartEnded, Recover, Recovered
from hw_interface.panda.player_process import CONNECT_TIMEOUT, PlayerProcess

LOG = logging.getLogger(__name__)
# A client waits 5 s for its answer, and is to hear why nothing moves.
LOAD_TIMEOUT = 3.0  # [s]
RECOVER_TIMEOUT = 3.0  # [s]
# [s] without a turn of the gripper's process. At rest nothing waits for it but the next motion, which is refused then.
HAND_SILENT_MOVING, HAND_SILENT_RESTING = 3.0, 10.0
SUPERVISOR = "supervisor"  # who asks the player
ROBOT_MODES = ("other", "idle", "move", "guiding", "reflex", "user_stopped", "recovery")  # as libfranka.RobotMode
IDLE, REFLEX, USER_STOPPED = 1, 4, 5  # of these
Phase = Literal["resting", "playing", "gripping"]


class PandaDriver(RobotStateMachine[ClearedMotion]):
    """One Panda.

    Args:
        start_player: Starts the player's process, connected to the control box.
        hand: The gripper.
        gate, cell, monitor_limits, clock: As for `RobotStateMachine`.
        time_waits: Whether robot time stands still while this process computes (a simulated box in lockstep).

    Raises:
        MachineError, RobotGoneError: As for `PlayerProcess`.
    """

    def __init__(
        self,
        start_player: Callable[[], PlayerProcess],
        hand: Hand,
        gate: Gate,
        cell: str,
        monitor_limits: MonitorLimits | None = None,
        clock: Callable[[], float] = time.time,
        time_waits: bool = False,
    ) -> None:
        self._start_player, self._hand = start_player, hand
        self._time_waits = time_waits
        self._player = start_player()
        self._connecting = False
        self._not_connected = ""  # why the control box is not there
        try:
            self._player.connected(CONNECT_TIMEOUT)
        except BaseException:
            self._player.close()
            raise
        row = self._latest_row()
        super().__init__(gate, cell, self._as_measured(row), row["q_d"], monitor_limits, clock)
        self._phase: Phase = "resting"
        self._posted = 0  # sequence number of the last clearance
        self._gripped_at = 0  # measurement at which the present gripper command was given
        self._motions = 0
        self._thinker = ThreadPoolExecutor(1, "change of speed")
        self._robot_mode = IDLE  # as if it had been: a box that is not makes the first tick say why
        self._read_up_to -= 1

    @property
    def control_box_mode(self) -> str | None:
        """What the control box says that it does."""
        return ROBOT_MODES[self._robot_mode] if 0 <= self._robot_mode < len(ROBOT_MODES) else "unknown"

    def tick(self) -> None:
        """Look at what was measured, monitor, and clear what comes next. Never raises."""
        try:
            trouble = self._look()
            self._faults.pop("looking", None)
        except Exception as error:
            self._log_fault("looking", error)
            trouble = internal_trouble(error)
        if trouble is not None:
            self._react(trouble)
        try:
            self._go_on()
            self._faults.pop("going on", None)
        except Exception as error:
            self._log_fault("going on", error)
            self._hold(internal_trouble(error))

    def acknowledge(self) -> None:
        """Become idle after a stop; a control box in a reflex recovers, a player that was ended is started again.

        Raises:
            RefusedError: busy: the arm still moves; user_stop: that is still pressed; not_ready: why the box, or the
                gripper, is not.
        """
        if self._motion is not None:
            super().acknowledge()
        self._look()  # something may have gone since the last tick
        if not self._connecting and not self._player.running:
            why = self._not_connected or "the process that talks to the control box had ended"
            self._connect_again()
            raise RefusedError("not_ready", f"{why}; connecting again now: acknowledge again in some seconds")
        if self._connecting:
            raise RefusedError("not_ready", "the control box is being connected to; acknowledge again in some seconds")
        if self._hand.read().connecting:
            raise RefusedError("not_ready", "the gripper is being connected to; acknowledge again in some seconds")
        if (why := self._hand_out(HAND_SILENT_MOVING)) is not None:
            self._hand.restart()
            raise RefusedError("not_ready", f"{why}; connecting to it anew: acknowledge again in some seconds")
        try:
            answer = self._player.ask(Recover(), Recovered, RECOVER_TIMEOUT)
        except StackError as error:
            raise RefusedError(
                "not_ready", f"the control box is still recovering ({error}); acknowledge again in some seconds"
            ) from error
        if isinstance(answer, Refusal):
            raise RefusedError(answer.code, answer.reason)
        # Only what is measured from now on counts.
        self._read_up_to, self._robot_mode = self._player.board.written, IDLE
        super().acknowledge()

    def close(self) -> None:
        """End player and gripper processes; the arm must rest."""
        self._thinker.shutdown(wait=False, cancel_futures=True)
        self._player.close()
        self._hand.close()

    # --- looking ------------------------------------------------------------------------------------------------

    def _latest_row(self) -> np.ndarray:
        self._read_up_to = self._player.board.written
        return self._player.board.measurements(self._read_up_to - 1)[-1]

    def _connect_again(self) -> None:
        """Start a new player; nothing moves by that, and the robot stays latched."""
        self._player.close()
        self._player, self._connecting, self._not_connected = self._start_player(), True, ""

    def _go_on_connecting(self) -> None:
        try:
            if not self._player.connected():
                return
        except StackError as error:
            LOG.error("%s", error)
            self._not_connected = str(error)
            self._player.kill()
        else:
            row = self._latest_row()
            self._measured, self._q_d = self._as_measured(row), row["q_d"].copy()
            self._robot_mode = int(row["mode"])
        self._connecting = False

    def _as_measured(self, row: np.ndarray) -> Measured:
        hand = self._hand.read()
        return Measured(row["q"].copy(), row["qd"].copy(), row["tau"].copy(), hand.width, hand.busy, hand.grasped, None)

    def _look(self) -> Trouble | None:
        """Take in what was measured since the last tick; why to stop, or None."""
        trouble: Trouble | None = None
        if self._connecting:
            self._go_on_connecting()
            return None
        for row in self._player.board.measurements(self._read_up_to):
            self._read_up_to = int(row["number"])
            trouble = self._take_in(row) or trouble
        return trouble or self._lost_player() or self._hand_fault()

    def _take_in(self, row: np.ndarray) -> Trouble | None:
        self._measured, self._q_d = self._as_measured(row), row["q_d"].copy()
        self._tracking_error = float(np.abs(row["q"] - row["q_d"]).max())
        before, self._robot_mode = self._robot_mode, int(row["mode"])
        motion = self._motion
        if motion is None:
            return self._changed_mode(before)
        if self._phase == "gripping":
            if motion.stopping:
                return None
            elapsed = self._read_up_to - self._gripped_at
            motion.observe(-1, self._q_d, self._measured, self._tracking_error)
            return motion.gripping(elapsed, self._measured, self._tracking_error)
        played = int(row["row"]) if int(row["motion"]) == motion.number else -1
        trouble = motion.observe(played, self._q_d, self._measured, self._tracking_error)
        self._progress = (motion.played, motion.samples)
        return trouble

    def _changed_mode(self, before: int) -> Trouble | None:
        """What the control box reports while nothing is played."""
        if self._robot_mode == before or self._robot_mode == IDLE:
            return None
        if self._robot_mode == USER_STOPPED:
            return Trouble(
                code="user_stop",
                reason="the user stop was pressed; release it, look at the cell, then acknowledge",
            )
        if self._robot_mode == REFLEX:
            return Trouble(code="reflex", reason="the control box reports a reflex; look at the cell, then acknowledge")
        return Trouble(
            code="not_ready",
            reason="the control box is no longer ready for motions (guiding, brakes locked, or another program moves "
            "it); see Desk, then acknowledge",
        )

    def _lost_player(self) -> Trouble | None:
        player = self._player
        if self._not_connected:
            return None  # said already
        if not player.running:
            trouble = Trouble(
                code="driver_gone",
                reason="the process that talks to the control box has ended, so the box brought the arm to rest by "
                "itself; look at the cell, then acknowledge",
            )
        elif (silent := player.silent(self._phase == "playing")) is not None:
            player.kill()
            trouble = Trouble(
                code="driver_hung",
                reason=f"the process that talks to the control box stood still for {silent:.1f} s (the box is silent, "
                "or the process hangs) and was ended, so the box brought the arm to rest by itself; look at the cell, "
                "then acknowledge",
            )
        else:
            return None
        self._phase = "resting"
        self._connect_again()
        return trouble

    def _hand_out(self, longest: float) -> str | None:
        """Why the gripper cannot be used, or None; silence counts when it lasts for more than `longest` in [s]."""
        hand = self._hand.read()
        if hand.fault is None and hand.silent > longest:
            return f"the gripper has not answered for {hand.silent:.1f} s"
        return hand.fault

    def _hand_fault(self) -> Trouble | None:
        fault = self._hand_out(HAND_SILENT_RESTING if self._motion is None else HAND_SILENT_MOVING)
        if fault is None or self._trouble is not None:
            return None
        if self._motion is not None and self._motion.stopping:
            return None
        return Trouble(code="gripper_fault", reason=f"{fault}; look at the gripper, then acknowledge")

    # --- going on -----------------------------------------------------------------------------------------------

    def _make_motion(self, trajectory: Trajectory, certificate: Certificate, speed: float) -> ClearedMotion:
        if self._connecting or self._not_connected or self._robot_mode != IDLE:
            raise RefusedError("not_ready", "the control box is not ready for a motion; see Desk, then acknowledge")
        if (why := self._hand_out(HAND_SILENT_MOVING)) is not None:
            raise RefusedError("not_ready", f"{why}; see to the gripper, then send the motion again")
        self._motions += 1
        motion = ClearedMotion(
            trajectory,
            certificate.serial,
            speed,
            self.gate,
            self._monitor_limits,
            self._clock(),
            self._motions,
            self._thinker,
            0 if self._time_waits else GIVE_UP,
        )
        try:
            self._player.link.send(LoadMotion(motion=motion.number))
            answer = self._player.ask(
                TrajectoryRequest.of(trajectory, certificate, self.epoch, SUPERVISOR), MotionLoaded, LOAD_TIMEOUT
            )
        except OSError as error:
            raise RefusedError("not_ready", "the process that talks to the control box is gone") from error
        except StackError as error:
            raise RefusedError(
                "not_ready", f"the control box is still recovering ({error}); acknowledge again in some seconds"
            ) from error
        if isinstance(answer, Refusal):
            raise RefusedError(answer.code, answer.reason)
        self._phase = "resting"
        return motion

    def _bring_to_rest(self, motion: ClearedMotion) -> None:
        if self._phase == "playing":
            motion.stop()

    def _go_on(self) -> None:
        motion = self._motion
        if motion is None:
            return
        if self._phase == "playing":
            self._go_on_playing(motion)
        elif motion.stopping:
            self._finish(motion, motion.stop_mode)
        elif self._phase == "gripping":
            self._go_on_gripping(motion)
        else:
            self._begin_part(motion)

    def _begin_part(self, motion: ClearedMotion) -> None:
        if motion.current.stop == motion.current.start:  # nothing moves: only the gripper does
            self._after_part(motion)
            return
        begin = BeginPart(motion=motion.number, part=motion.part, first=motion.first_row, begin=motion.begin)
        self._posted = self._player.board.post(motion.number, motion.part, motion.begin_part())
        self._player.link.send(begin)
        self._phase = "playing"

    def _go_on_playing(self, motion: ClearedMotion) -> None:
        for command in motion.due_events():
            self._hand.begin(command)
        try:
            message = self._player.link.receive()
        except (EOFError, OSError):
            return  # the next tick sees that it is gone
        except MessageError as error:
            self._react(internal_trouble(error))
            return
        if isinstance(message, PartEnded) and (message.motion, message.part) == (motion.number, motion.part):
            self._part_ended(motion, message)
            return
        if (why := motion.thought()) is not None:
            LOG.warning("the speed stays as it was: %s", why)
            self._speed_wanted = motion.speed
        board = self._player.board
        refused, late = board.refused
        if refused == self._posted and not late:
            self._react(Trouble(code="internal_error", reason="the player refused a clearance; see its log"))
        elif refused == self._posted:
            motion.refused()
        if board.taken == self._posted or refused == self._posted:
            clearance = motion.next_clearance()
            if clearance is not None:
                self._posted = board.post(motion.number, motion.part, clearance)

    def _part_ended(self, motion: ClearedMotion, ended: PartEnded) -> None:
        # The last measurements of the part tell where it ended.
        for row in self._player.board.measurements(self._read_up_to):
            self._read_up_to = int(row["number"])
            self._take_in(row)
        self._phase = "resting"
        if ended.outcome == "aborted":
            trouble = Trouble(code=ended.code or "reflex", reason=ended.reason)
            LOG.error("%s: %s", trouble.code, trouble.reason)
            motion.trouble = trouble
            self._finish(motion, "reflex")
        elif motion.stopping:
            self._finish(motion, motion.stop_mode)
        elif ended.row < motion.end_row:
            motion.trouble = Trouble(
                code="supervisor_late",
                reason=f"the supervisor did not clear the motion in time, so the arm came to rest on its path at row "
                f"{ended.row} of {motion.end_row}; see what keeps this machine busy, then acknowledge",
            )
            self._finish(motion, "reflex")
        else:
            self._after_part(motion)

    def _after_part(self, motion: ClearedMotion) -> None:
        event = motion.current.gripper
        if event is not None:
            self._hand.begin(event.command)
            self._gripped_at = self._read_up_to
            self._phase = "gripping"
        else:
            self._next_part(motion)

    def _go_on_gripping(self, motion: ClearedMotion) -> None:
        event = motion.current.gripper
        assert event is not None
        elapsed = self._read_up_to - self._gripped_at
        if elapsed * SAMPLE_TIME >= event.dwell and not motion.waiting:
            self._next_part(motion)

    def _next_part(self, motion: ClearedMotion) -> None:
        self._phase = "resting"
        if motion.next_part():
            return
        self._progress = (motion.samples, motion.samples)
        self._finish(motion, "idle")

    def _hold(self, trouble: Trouble) -> None:
        """Without clearances the player rests by itself; what it does until then is on record."""
        if self._phase == "playing" and self._player.running:
            if self._motion is not None:
                self._motion.stopping, self._motion.stop_mode, self._motion.trouble = True, "reflex", trouble
                self._mode = "stopping"
            return
        super()._hold(trouble)
