"""Messages of ROS 2 into an MCAP file that Foxglove, Rerun and ROS 2's own tools open."""

import time
from pathlib import Path

from control.errors import ConfigError
from hw_interface.ros2.encoding import Ros2Message
from perception.ros2.mcap_file import Ros2McapFile

CHUNK = 64 * 1024  # bytes, about half a second of states; a killed process loses no more


class McapSink:
    """One file; not thread-safe.

    Args:
        path: File to write, ending in .mcap.

    Raises:
        ConfigError: Another ending, it exists, or it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        if path.suffix.lower() != ".mcap":
            raise ConfigError(f"'{path}' is no name of an MCAP file; it must end in .mcap")
        if path.exists():
            raise ConfigError(f"'{path}' exists; name another file, or remove it")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = Ros2McapFile(path, CHUNK)
        except OSError as error:
            raise ConfigError(f"cannot write '{path}': {error.strerror}; name another file") from error

    def put(self, message: Ros2Message) -> None:
        """Add a message, recorded now."""
        self._file.put(f"/{message.topic}", message.kind, message.stamp_ns, message.data, time.time_ns())

    def close(self) -> None:
        """Complete the file."""
        self._file.close()
