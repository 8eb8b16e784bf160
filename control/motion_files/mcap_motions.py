"""Motions from MCAP recordings of ROS 2: planned trajectories and recorded joint states.

    trajectory_msgs/msg/JointTrajectory   a motion by itself
    moveit_msgs/msg/RobotTrajectory       its joint_trajectory
    moveit_msgs/msg/DisplayTrajectory     its only trajectory's joint_trajectory
    sensor_msgs/msg/JointState            all messages of a topic together are one motion, as it was measured

Messages are CDR with the definitions that the recording carries (schema encoding ros2msg).
"""

import io
import mmap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from control.errors import MotionFileError
from control.motion_files.contents import MAX_DURATION, MAX_ROWS, MotionFile, checked
from control.motion_files.csv_motions import width_of_fingers
from control.motion_files.joint_names import VALID_JOINTS, find_joints, is_joint, shortened
from replan_base.parts import install_part

if TYPE_CHECKING:
    from mcap.reader import SeekingReader

TRAJECTORY, STATE = "trajectory_msgs/msg/JointTrajectory", "sensor_msgs/msg/JointState"
# Where a message of each type has its joint trajectory: names of fields, "[]" for the only element of a list.
INSIDE = {
    TRAJECTORY: (),
    "moveit_msgs/msg/RobotTrajectory": ("joint_trajectory",),
    "moveit_msgs/msg/DisplayTrajectory": ("trajectory", "[]", "joint_trajectory"),
}
READABLE = (*INSIDE, STATE)
MAGIC = b"\x89MCAP0\r\n"
LARGEST_MESSAGE = 320 * MAX_ROWS  # bytes; a point of nine joints with velocities, accelerations and efforts has 320


@dataclass(frozen=True)
class _Channel:
    """A topic of one type: how many messages it has."""

    topic: str
    kind: str
    count: int

    @property
    def label(self) -> str:
        return f"'{shortened(self.topic)}' ({self.kind}, {self.count} message{'s' if self.count != 1 else ''})"


def read_mcap(path: Path, topic: str | None = None, index: int | None = None) -> MotionFile:
    """Read a motion from an MCAP file.

    Args:
        path: The recording.
        topic: Which topic to read; needed when more than one holds motions.
        index: Which of a topic's trajectories, from 0 in the order of the file; needed when it has more than one.

    Raises:
        MotionFileError: A file that is cut off or damaged, no motion in it, a choice that is missing or does not
            exist, or numbers that cannot be used (by point of the trajectory, or message of the recording, from 0).
        OSError: The file cannot be opened or read.
    """
    with _opened(path) as reader:
        channel = _chosen(path, _channels(reader), topic)
        if channel.kind == STATE:
            if index is not None:
                raise MotionFileError(
                    f"'{path}': topic {channel.label} is a recording, all of whose messages are one motion; leave out "
                    "the index"
                )
            return _states(path, channel, _decoded(path, reader, channel))
        k = _index(path, channel, index)
        for number, message in enumerate(_decoded(path, reader, channel)):
            if number == k:
                return _trajectory(path, channel, k, message)
    raise MotionFileError(f"'{path}' ends before message {k} of topic '{channel.topic}': it is damaged")


@contextmanager
def _opened(path: Path) -> "Iterator[SeekingReader]":
    """A reader of a file that is complete; errors of any library meeting damaged bytes become ours."""
    try:
        import mcap_ros2.decoder  # noqa: F401 -- used further on; asked for here, with the rest
        from mcap.reader import SeekingReader  # here, so that nobody needs it for other formats
    except ModuleNotFoundError as error:
        raise MotionFileError(
            f"'{path}' needs the package {error.name}, which is not installed; run: {install_part('twin')}"
        ) from error
    with path.open("rb") as file:
        start = file.read(len(MAGIC))
        if start != MAGIC:
            raise MotionFileError(f"'{path}' is not an MCAP file: it does not begin like one")
        # Mapped, so that a length that was damaged cannot make anybody reserve memory for it.
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
            if mapped[-len(MAGIC) :] != MAGIC or len(mapped) < 2 * len(MAGIC):
                raise MotionFileError(
                    f"'{path}' is cut off: a complete MCAP file ends otherwise; `mcap recover` keeps what is whole"
                )
            try:
                yield SeekingReader(
                    mapped,  # type: ignore[arg-type]
                    validate_crcs=True,
                    record_size_limit=len(mapped),
                )
            except (OSError, MotionFileError):
                raise
            except Exception as error:  # mcap, zstandard and lz4 meet damaged bytes with errors of a dozen kinds
                what = " ".join(f"{type(error).__name__} {error}".split())
                raise MotionFileError(f"'{path}' is damaged: {shortened(what, 120)}") from error


def _channels(reader: "SeekingReader") -> list[_Channel]:
    """All topics of a recording by type, in the order of their names."""
    counts: dict[tuple[str, str, str], int] = {}
    summary = reader.get_summary()
    if summary is not None and summary.statistics is not None:
        for number, channel in summary.channels.items():
            schema = summary.schemas.get(channel.schema_id)
            key = (channel.topic, schema.name if schema else "no type", schema.encoding if schema else "")
            counts[key] = counts.get(key, 0) + summary.statistics.channel_message_counts.get(number, 0)
    else:
        for schema, channel, _ in reader.iter_messages(log_time_order=False):
            key = (channel.topic, schema.name if schema else "no type", schema.encoding if schema else "")
            counts[key] = counts.get(key, 0) + 1
    return [
        _Channel(topic, kind if encoding in ("ros2msg", "") else f"{kind} in {encoding}", count)
        for (topic, kind, encoding), count in sorted(counts.items())
    ]


def _chosen(path: Path, channels: list[_Channel], topic: str | None) -> _Channel:
    has = f"it has {'; '.join(c.label for c in channels) or 'no topics'}"
    motions = [c for c in channels if c.kind in READABLE and c.count]
    if not motions:
        raise MotionFileError(f"'{path}' holds no motion: none of {', '.join(READABLE)} in ros2msg; {has}")
    if topic is None:
        if len(motions) > 1:
            raise MotionFileError(
                f"'{path}' holds several motions: {'; '.join(c.label for c in motions)}; choose a topic"
            )
        return motions[0]
    chosen = [c for c in motions if c.topic == topic]
    if not chosen:
        names = ", ".join(f"'{shortened(c.topic)}'" for c in motions)
        raise MotionFileError(f"'{path}' has no motion on topic '{shortened(topic)}'; topics with motions are {names}")
    if len(chosen) > 1:
        raise MotionFileError(f"'{path}': topic '{shortened(topic)}' has messages of several types: {has}")
    return chosen[0]


def _index(path: Path, channel: _Channel, index: int | None) -> int:
    if index is None and channel.count > 1:
        raise MotionFileError(
            f"'{path}' holds several motions: topic {channel.label}; choose an index, 0 to {channel.count - 1}"
        )
    if index is not None and not 0 <= index < channel.count:
        raise MotionFileError(
            f"'{path}': topic {channel.label} has no message {index}; valid are 0 to {channel.count - 1}"
        )
    return index or 0


def _decoded(path: Path, reader: "SeekingReader", channel: _Channel) -> Iterator[Any]:
    """Messages of a channel in the order of the file."""
    from mcap_ros2.decoder import DecoderFactory

    decoders = DecoderFactory()
    for schema, found, message in reader.iter_messages(topics=[channel.topic], log_time_order=False):
        if schema is None or schema.name != channel.kind:
            continue
        if len(message.data) > LARGEST_MESSAGE:
            raise MotionFileError(
                f"'{path}': a message of topic {channel.label} has {len(message.data)} bytes; a motion has at most "
                f"{MAX_ROWS} points"
            )
        with redirect_stderr(io.StringIO()), redirect_stdout(io.StringIO()):  # it prints what it cannot parse
            decoder = decoders.decoder_for(found.message_encoding, schema)
        if decoder is None:
            raise MotionFileError(
                f"'{path}': topic {channel.label} is encoded as '{shortened(found.message_encoding)}'; it must be cdr"
            )
        yield decoder(message.data)


def _trajectory(path: Path, channel: _Channel, index: int, message: Any) -> MotionFile:
    for field in INSIDE[channel.kind]:
        if field != "[]":
            message = getattr(message, field)
        elif len(message) != 1:
            raise MotionFileError(
                f"'{path}': message {index} of topic {channel.label} has {len(message)} trajectories; it must have one"
            )
        else:
            message = message[0]
    names = list(message.joint_names)
    where = f"'{path}': message {index} of topic '{channel.topic}'"
    if len(message.points) > MAX_ROWS:
        raise MotionFileError(f"{where} has {len(message.points)} points; at most {MAX_ROWS} are read")
    if not message.points:
        raise MotionFileError(f"{where} has no points; a motion has at least 2")
    joints = find_joints(path, names)
    times = np.array([_seconds(point.time_from_start) for point in message.points])
    arrays = {
        "q": _table(where, message.points, "positions", len(names)),
        "qd": _table(where, message.points, "velocities", len(names)),
        "qdd": _table(where, message.points, "accelerations", len(names)),
    }
    if arrays["q"] is None:
        raise MotionFileError(f"{where} has no positions in its points; a motion needs them")
    arm = {key: None if a is None else np.ascontiguousarray(a[:, joints.arm]) for key, a in arrays.items()}
    return checked(
        MotionFile(
            path=path,
            source=f"{channel.kind}, message {index} of topic '{channel.topic}'",
            times=times,
            joint_names=joints.names,
            row_word="point",
            row_numbers=np.arange(len(times)),
            gripper_width=width_of_fingers(arrays["q"][:, joints.fingers]) if joints.fingers else None,
            **arm,  # type: ignore[arg-type]
        ),
        seconds=True,
    )


def _states(path: Path, channel: _Channel, messages: Iterator[Any]) -> MotionFile:
    """A recording: rows are the messages that have the arm's joints; fingers may come in messages of their own."""
    times: list[float] = []
    rows: list[Sequence[float]] = []
    speeds: list[Sequence[float]] = []
    numbers: list[int] = []
    width, widths = np.nan, []
    ignored: set[str] = set()
    first_names, joints, base = None, None, 0
    for number, message in enumerate(messages):
        where = f"'{path}', message {number} of topic '{channel.topic}'"
        known = [(k, name) for k, name in enumerate(message.name) if is_joint(name)]
        ignored.update(name for name in message.name if not is_joint(name))
        if len(message.position) != len(message.name):
            raise MotionFileError(f"{where} has {len(message.name)} names but {len(message.position)} positions")
        fingers = [message.position[k] for k, name in known if "finger" in name]
        if fingers:
            width = float(width_of_fingers(np.array([fingers]))[0])
        if len(fingers) == len(known):
            continue  # of another device, or of the fingers alone
        names = [name for _, name in known]
        if joints is None or names != first_names:
            first_names, joints = names, find_joints(path, names)
        stamp = message.header.stamp
        if not times:
            base = stamp.sec
        columns = [known[k][0] for k in joints.arm]
        times.append(stamp.sec - base + stamp.nanosec * 1e-9)
        rows.append([message.position[k] for k in columns])
        if len(message.velocity) == len(message.name):
            speeds.append([message.velocity[k] for k in columns])
        numbers.append(number)
        widths.append(width)
        if times[-1] - times[0] > MAX_DURATION or len(times) > MAX_ROWS:
            break
    if joints is None:
        others = ", ".join(shortened(n) for n in sorted(ignored)[:8]) or "fingers only"
        raise MotionFileError(
            f"'{path}': no message of topic {channel.label} has the arm's joints, but {others}; valid are "
            f"{VALID_JOINTS}"
        )
    gripper = np.array(widths)
    known_widths = np.flatnonzero(np.isfinite(gripper))
    if len(known_widths):
        gripper[: known_widths[0]] = gripper[known_widths[0]]
    notes = ["positions were measured, not commanded: noise of the sensors counts as motion"]
    if ignored:
        notes.append(f"joints of other devices were left out: {', '.join(shortened(n) for n in sorted(ignored)[:8])}")
    return checked(
        MotionFile(
            path=path,
            source=f"{channel.kind}, topic '{channel.topic}'",
            times=np.array(times),
            q=np.array(rows, dtype=float).reshape(-1, 7),
            joint_names=joints.names,
            row_word="message",
            row_numbers=np.array(numbers),
            qd=np.array(speeds, dtype=float) if len(speeds) == len(rows) else None,
            gripper_width=gripper if len(known_widths) else None,
            notes=tuple(notes),
        ),
        seconds=True,
    )


def _seconds(stamp: Any) -> float:
    return stamp.sec + stamp.nanosec * 1e-9


def _table(where: str, points: Sequence[Any], field: str, count: int) -> np.ndarray | None:
    """One field of all points, shape (n, count), or None where no point has it."""
    lengths = np.array([len(getattr(point, field)) for point in points])
    if not lengths.any():
        return None
    if np.any(lengths != count):
        k = int(np.argmax(lengths != count))
        raise MotionFileError(
            f"{where}, point {k} has {lengths[k]} {field}; it needs {count}, one per joint name"
            + ("" if field == "positions" else ", or none in all points")
        )
    return np.array([getattr(point, field) for point in points], dtype=float)
