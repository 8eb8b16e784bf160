"""A run as an MCAP file for Foxglove, Rerun and ROS 2's tools: what the robot did, what was seen, what happened."""

import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from hw_interface.link.security import LinkSecurity
    from perception.frames import RgbdFrame
    from sim_check.cells.loading import CellConfig

FILE_NAME = "run.mcap"
LONGEST_TEXT = 2000  # characters of an event's fields
BAD: dict[str, Literal["warn", "error"]] = {
    "failure": "warn",
    "refused": "warn",
    "retiming_failed": "warn",
    "ended_early": "error",
}


class RunRecording:
    """Records one run on a thread of its own, with a session of its own; complete when closed.

    Args:
        path: File to write.
        endpoint: The robot process's.
        cell: Where base and cameras stand.
        security: Certificates, for a "tls/" endpoint.
        say: Gets a line if the recording has to end before the run does.

    Raises:
        ConfigError: The file cannot be written.
        RobotGoneError: Nobody answers at the endpoint.
    """

    def __init__(
        self,
        path: Path,
        endpoint: str,
        cell: "CellConfig",
        security: "LinkSecurity | None",
        say: Callable[[str], None],
    ) -> None:
        from hw_interface.link.transport import open_client_session
        from hw_interface.ros2.mcap_sink import McapSink
        from hw_interface.ros2.relay import Relay
        from replan.robot.ros2_view import make_view

        self._view = make_view(cell)
        self._session = open_client_session(endpoint, security=security)
        try:
            self._sink = McapSink(path)
        except BaseException:
            self._session.close()
            raise
        self._relay = Relay(self._session, self._view, [self._sink])
        self._ended = threading.Event()
        self._say = say
        self._thread = threading.Thread(target=self._record, daemon=True)
        self._thread.start()

    def frame(self, frame: "RgbdFrame") -> None:
        """Record a picture that was taken; from any thread."""
        self._relay.show(frame)

    def said(self, text: str) -> None:
        """Record a line that people were told; from any thread."""
        self._relay.tell(self._view.event(time.time(), "info", "replan", text))

    def event(self, event: str, fields: dict[str, Any]) -> None:
        """Record an event of the run's log; from any thread.

        Args:
            event: Its name.
            fields: What it says, as JSON knows it.
        """
        text = json.dumps(fields, ensure_ascii=False)
        text = text if len(text) <= LONGEST_TEXT else text[:LONGEST_TEXT] + " ..."
        self._relay.tell(self._view.event(time.time(), BAD.get(event, "info"), f"replan.{event}", text))

    def telling(self, say: Callable[[str], None]) -> Callable[[str], None]:
        """`say`, with each line recorded as well."""

        def both(text: str) -> None:
            self.said(text)
            say(text)

        return both

    def _record(self) -> None:
        try:
            self._relay.run(self._ended.is_set)
            self._relay.close()
        except OSError as error:  # a full disk, say; the run goes on without its recording
            self._say(f"the recording ends here: {error.strerror}")

    def close(self) -> None:
        """Complete the file."""
        self._ended.set()
        self._thread.join()
        self._sink.close()
        self._session.close()
