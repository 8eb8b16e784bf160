"""What a robot side writes down: every request with its answer, every change of mode, every motion's end."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from control.errors import MachineError, RefusedError, StackError
from hw_interface.cell.audit_log import AuditLog
from hw_interface.cell.robot_state_machine import RobotStateMachine


class Audit:
    """Keeps the audit log of one robot side, if there is one; stops the robot when it cannot be kept.

    Args:
        driver: The robot.
        log: Where to write; None writes nothing.
    """

    def __init__(self, driver: RobotStateMachine, log: AuditLog | None) -> None:
        self._driver, self._log = driver, log
        self._mode = ""
        self.watch()

    @contextmanager
    def asking(self, what: str, force: bool = True, **fields: Any) -> Iterator[dict[str, Any]]:
        """Around a request that may lead to motion: written down, and on the disk, before it is answered.

        Args:
            what: What is asked for.
            force: Whether the request is on the disk before anything is done; False where nothing moves until the
                request is answered: the line about the answer, which always is on the disk first, takes it there.
            fields: JSON values.

        Yields:
            Fields to add to the line about the answer.

        Raises:
            RefusedError: audit_log: it cannot be written down, so nothing is done; or what the request itself raises.
        """
        self._must_write("asked", force, what=what, **fields)
        note: dict[str, Any] = {}
        try:
            yield note
        except StackError as error:
            code = error.code if isinstance(error, RefusedError) else type(error).__name__
            self.note("refused", what=what, code=code, reason=str(error)[:2000], **fields, **note)
            raise
        self.note("granted", what=what, **fields, **note)

    def note(self, event: str, **fields: Any) -> None:
        """Write down what has happened; the robot stops when that cannot be done."""
        if self._log is None:
            return
        try:
            self._log.record(event, force=True, **fields)
        except MachineError as error:
            self._driver.reflex("audit_log", str(error))

    def watch(self) -> None:
        """Write down a change of mode and what became of a motion."""
        driver = self._driver
        mode = driver.mode
        if mode == self._mode:
            return
        before, self._mode = self._mode, mode
        state = driver.state()
        fields: dict[str, Any] = {"mode": mode, "before": before, "epoch": driver.epoch}
        if state.last_error is not None:
            fields |= {"code": state.last_error.code, "reason": state.last_error.reason}
        if before in ("moving", "stopping") and state.motion_serial is not None and not driver.moving:
            result = driver.result(state.motion_serial)
            fields |= {
                "serial": result.serial,
                "outcome": result.outcome,
                "played": result.played,
                "samples": result.samples,
                "max_tracking_error": result.max_tracking_error,
            }
        self.note("mode", **fields)

    def _must_write(self, event: str, force: bool, **fields: Any) -> None:
        if self._log is None:
            return
        try:
            self._log.record(event, force=force, **fields)
        except MachineError as error:
            raise RefusedError("audit_log", str(error)) from error
