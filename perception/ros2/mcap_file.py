"""Messages of ROS 2 into an MCAP file, chunk by chunk: a file that was cut off is whole up to its last chunk."""

from pathlib import Path
from types import TracebackType

from perception.errors import MissingPackageError
from perception.ros2.messages import definition, message_types
from replan_base.parts import install_part

CHUNK = 4 * 1024 * 1024  # bytes; a reader holds one chunk


class Ros2McapFile:
    """One file; use it as a context manager, which completes the file however it ends. Not thread-safe.

    Args:
        path: File to write.
        chunk: Bytes of messages that are collected before they are written; what a killed process loses.

    Raises:
        MissingPackageError: The packages that encode and write are not installed.
        OSError: The file cannot be written.
    """

    def __init__(self, path: Path, chunk: int = CHUNK) -> None:
        message_types()
        try:
            from mcap.writer import CompressionType, Writer  # here, so that reading other formats needs no mcap
        except ModuleNotFoundError as error:
            raise MissingPackageError(
                f"writing '{path}' needs the package {error.name}, which is not installed; run: " + install_part("twin")
            ) from error
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._file = path.open("wb")
        self._writer = Writer(self._file, chunk_size=chunk, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="replan")

    def __enter__(self) -> "Ros2McapFile":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Complete the file."""
        if not self._file.closed:
            self._writer.finish()
            self._file.close()

    def put(self, topic: str, kind: str, stamp: int, data: bytes | memoryview, logged: int | None = None) -> None:
        """Add a message.

        Args:
            topic: For instance "/joint_states".
            kind: For instance "sensor_msgs/msg/JointState"; a type of `perception.ros2.messages.message_types`.
            stamp: When it was published in [ns].
            data: Its bytes.
            logged: When it was recorded in [ns], by which players order; None for the same.
        """
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition(kind).encode())
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind])
        at = stamp if logged is None else logged
        # The library's type hints know only bytes; it writes every buffer as it is.
        self._writer.add_message(self._channels[topic], at, data, publish_time=stamp)  # type: ignore[arg-type]
        self._file.flush()  # whatever chunk was completed is safe from the end of this process
