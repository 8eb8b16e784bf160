"""Messages of an MCAP file one after the other, past whatever is damaged, holding no more than one chunk of it.

Files that were cut off while they were recorded are read up to where they end.
"""

import io
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from perception.errors import FrameError
from perception.recordings.base import Skipped
from replan_base.parts import install_part

MAGIC = b"\x89MCAP0\r\n"
HEAD = 9  # bytes in front of each record: what it is, and its length


@dataclass(frozen=True)
class RosMessage:
    """One decoded message.

    Attributes:
        topic: Its topic.
        kind: Its type, for instance "sensor_msgs/msg/Image".
        number: Which of its topic's messages it is in the file, from 0.
        content: Its fields.
        time: When it was recorded in [ns].
    """

    topic: str
    kind: str
    number: int
    content: Any
    time: int


class McapStream:
    """One file, which may be read several times.

    Args:
        path: The file.

    Attributes:
        topics: Type of each topic that the file's summary names; empty where it was cut off.

    Raises:
        FrameError: It is no MCAP file, or the packages that read it are missing.
    """

    def __init__(self, path: Path) -> None:
        try:
            import mcap_ros2.decoder  # noqa: F401 -- used further on; asked for here, with the rest
            from mcap.reader import SeekingReader  # here, so that nobody needs it for other formats
        except ModuleNotFoundError as error:
            raise FrameError(
                f"'{path}' needs the package {error.name}, which is not installed; run: {install_part('twin')}"
            ) from error
        self._path = path
        self._size = path.stat().st_size
        self._channels: dict[int, Any] = {}
        self._schemas: dict[int, Any] = {}
        self._in_chunk: dict[int, set[int]] = {}  # channels by the chunk's offset
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise FrameError(f"'{path}' is not an MCAP file: it does not begin like one")
            file.seek(0)
            try:
                summary = SeekingReader(file, record_size_limit=self._size).get_summary()  # type: ignore[arg-type]
            except Exception:  # cut off or damaged: everything needed stands among the messages as well
                summary = None
        if summary is not None:
            self._channels, self._schemas = dict(summary.channels), dict(summary.schemas)
            self._in_chunk = {c.chunk_start_offset: set(c.message_index_offsets) for c in summary.chunk_indexes}
        self.topics = {c.topic: self._kind(c) for c in self._channels.values()}

    def messages(self, wanted: Callable[[str, str], bool]) -> Iterator[RosMessage | Skipped]:
        """Messages in the order of the file's chunks, by time within a chunk; what is damaged in their place.

        Args:
            wanted: Says of (topic, type) whether to decode it; asked for each message.
        """
        from mcap_ros2.decoder import DecoderFactory

        decoders, numbers = DecoderFactory(), {}
        for batch in self._batches(wanted):
            if isinstance(batch, Skipped):
                yield batch
                continue
            batch.sort(key=lambda m: m.log_time)
            batch.reverse()  # so that messages of the same time keep their order
            while batch:
                record = batch.pop()  # what was given out is not held any longer
                channel = self._channels.get(record.channel_id)
                if channel is None:
                    continue
                number = numbers[channel.topic] = numbers.get(channel.topic, -1) + 1
                if self._is_wanted(channel, wanted):
                    yield self._decoded(decoders, channel, number, record)

    def _batches(self, wanted: Callable[[str, str], bool]) -> Iterator[list[Any] | Skipped]:
        """Message records of one chunk after the other, chunks apart in which nothing is wanted."""
        from mcap.opcode import Opcode

        for offset, code, data in self._records():
            if isinstance(data, Skipped):
                yield data
                continue
            known = self._in_chunk.get(offset) if code == Opcode.CHUNK else None
            if known and not any(self._is_wanted(self._channels.get(c), wanted) for c in known):
                continue
            try:
                batch = self._parsed(code, data)
            except Exception as error:  # mcap, zstandard and lz4 meet damaged bytes with errors of a dozen kinds
                batch = Skipped(f"bytes {offset} to {offset + HEAD + len(data)} of the file", _said(error))
            data = None  # not held while the batch is worked on
            yield batch

    def _parsed(self, code: int, data: bytes) -> list[Any]:
        """Message records inside a record; channels and schemas are remembered."""
        from mcap.data_stream import ReadDataStream
        from mcap.opcode import Opcode
        from mcap.records import Channel, Chunk, Message, Schema
        from mcap.stream_reader import breakup_chunk

        stream = ReadDataStream(io.BytesIO(data))
        if code == Opcode.CHUNK:
            found = breakup_chunk(Chunk.read(stream), validate_crc=True)
        elif code == Opcode.MESSAGE:
            found = [Message.read(stream, len(data))]
        else:
            found = [(Schema if code == Opcode.SCHEMA else Channel).read(stream)]
        for record in found:
            if isinstance(record, Schema):
                self._schemas[record.id] = record
            elif isinstance(record, Channel):
                self._channels[record.id] = record
        return [record for record in found if isinstance(record, Message)]

    def _records(self) -> Iterator[tuple[int, int, Any]]:
        """(offset, what it is, content) of each record of the data section; a Skipped as content of what is damaged.

        Where a record cannot be one, or reaches into a chunk that the summary knows, reading goes on at that chunk.
        """
        from mcap.opcode import Opcode

        of_use = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL)
        chunks = sorted(self._in_chunk)
        with self._path.open("rb") as file:
            offset = len(MAGIC)
            while True:
                file.seek(offset)
                head = file.read(HEAD)
                code, length = head[0] if head else 0, int.from_bytes(head[1:], "little")
                end, following = offset + HEAD + length, bisect_right(chunks, offset)
                chunk = chunks[following] if following < len(chunks) else None
                if chunk is None and len(head) == HEAD and code in (Opcode.DATA_END, Opcode.FOOTER):
                    return
                if chunk is not None and (end > chunk or code in (0, Opcode.DATA_END, Opcode.FOOTER)):
                    yield offset, code, Skipped(f"bytes {offset} to {chunk} of the file", "they are damaged")
                    offset = chunk
                    continue
                if len(head) < HEAD or end > self._size:
                    rest = f"the last {self._size - offset} bytes of the file"
                    yield offset, code, Skipped(rest, "the file is cut off there; it was not closed when it was made")
                    return
                if code in of_use:
                    yield offset, code, file.read(length)
                offset = end

    def _kind(self, channel: Any) -> str:
        schema = self._schemas.get(channel.schema_id)
        return schema.name if schema else "no type"

    def _is_wanted(self, channel: Any, wanted: Callable[[str, str], bool]) -> bool:
        return channel is not None and wanted(channel.topic, self._kind(channel))

    def _decoded(self, decoders: Any, channel: Any, number: int, record: Any) -> RosMessage | Skipped:
        where = f"message {number} of topic '{channel.topic}'"
        try:
            with redirect_stderr(io.StringIO()), redirect_stdout(io.StringIO()):  # it prints what it cannot parse
                decoder = decoders.decoder_for(channel.message_encoding, self._schemas.get(channel.schema_id))
            if decoder is None:
                return Skipped(where, f"it is encoded as '{channel.message_encoding}'; it must be cdr of ros2msg")
            content = decoder(record.data)
        except Exception as error:  # whatever its bytes make the decoder do
            return Skipped(where, f"it cannot be decoded: {_said(error)}")
        return RosMessage(channel.topic, self._kind(channel), number, content, record.log_time)


def _said(error: Exception) -> str:
    return " ".join(f"{type(error).__name__} {error}".split())[:120]
