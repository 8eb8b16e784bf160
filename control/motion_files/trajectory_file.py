"""Our own trajectory files: everything of a trajectory, bit for bit, in an NPZ file that others can read too.

    format          "replan-trajectory"
    version         1
    joint_names     (7,)    strings, the columns of q, qd and qdd
    sample_time     0.001   in [s]
    q, qd, qdd      (n, 7)  in [rad], [rad/s], [rad/s^2]
    gripper         JSON text: [{"time": s, "dwell": s, "kind": "move" or "grasp", "width": m, "force": N}, ..]
    segments        JSON text: [{"name", "start", "stop", "held", "touching": [[a, b], ..], "held_mass": kg | null}, ..]

JSON keeps float64 exactly: Python writes the shortest digits that read back as the same number.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from control.errors import MotionFileError, TrajectoryError
from control.motion_files.joint_names import shortened
from control.robot.limits import JOINT_NAMES
from control.trajectory.samples import SAMPLE_TIME, GripperCommand, GripperEvent, Trajectory, TrajectorySegment

FORMAT = "replan-trajectory"
VERSION = 1
OWN_KEYS = ("format", "version", "joint_names", "sample_time", "q", "qd", "qdd", "gripper", "segments")

Count = Annotated[int, Field(ge=0)]
Amount = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _EventEntry(BaseModel):
    """`control.trajectory.samples.GripperEvent` with its command."""

    model_config = ConfigDict(extra="forbid")
    time: Amount
    dwell: Amount
    kind: Literal["move", "grasp"]
    width: Amount
    force: Amount


class _SegmentEntry(BaseModel):
    """`control.trajectory.samples.TrajectorySegment`."""

    model_config = ConfigDict(extra="forbid")
    name: str
    start: Count
    stop: Count
    held: str | None
    touching: tuple[tuple[str, str], ...]
    held_mass: Amount | None = None  # files written before it was there do not have it


_EVENTS = TypeAdapter(tuple[_EventEntry, ...])
_SEGMENTS = TypeAdapter(tuple[_SegmentEntry, ...])


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory; `control.motion_files.reading.read_motion` gives it back with the same content hash.

    Args:
        path: File to write, ending in .npz; replaced when it exists.
        trajectory: With its columns in the robot's order.

    Raises:
        TrajectoryError: Another ending or order of joints.
        OSError: The file cannot be written.
    """
    if path.suffix != ".npz":
        raise TrajectoryError(f"a trajectory is written to a file that ends in .npz, not to '{path}'")
    if trajectory.joint_names != JOINT_NAMES:
        raise TrajectoryError(f"the trajectory's joints are {trajectory.joint_names}; write them as {JOINT_NAMES}")
    events = tuple(
        _EventEntry(time=e.time, dwell=e.dwell, kind=e.command.kind, width=e.command.width, force=e.command.force)
        for e in trajectory.gripper
    )
    segments = tuple(
        _SegmentEntry(
            name=s.name, start=int(s.start), stop=int(s.stop), held=s.held, touching=s.touching, held_mass=s.held_mass
        )
        for s in trajectory.segments
    )
    np.savez_compressed(
        path,
        format=np.array(FORMAT),
        version=np.array(VERSION),
        joint_names=np.array(trajectory.joint_names),
        sample_time=np.array(SAMPLE_TIME),
        q=trajectory.q,
        qd=trajectory.qd,
        qdd=trajectory.qdd,
        gripper=np.array(_EVENTS.dump_json(events).decode()),
        segments=np.array(_SEGMENTS.dump_json(segments).decode()),
    )


def trajectory_of(path: Path, arrays: Mapping[str, np.ndarray]) -> tuple[Trajectory, str]:
    """The trajectory in the arrays of one of our own files, and its format in words.

    Raises:
        MotionFileError: Another format or version, missing or unknown arrays, or values that do not belong together.
    """
    form, version = str(arrays["format"]), str(arrays.get("version"))
    if form != FORMAT:
        raise MotionFileError(f"'{path}' has format '{shortened(form)}'; a trajectory has '{FORMAT}' (or no format)")
    if version != str(VERSION):
        raise MotionFileError(
            f"'{path}' has version {shortened(version)} of {FORMAT}; this program reads version {VERSION}: use the "
            "program that wrote it"
        )
    missing = [key for key in OWN_KEYS if key not in arrays]
    unknown = [key for key in arrays if key not in OWN_KEYS]
    if missing or unknown:
        raise MotionFileError(
            f"'{path}' {'lacks ' + ', '.join(missing) if missing else 'has unknown arrays ' + ', '.join(unknown)}; "
            f"{FORMAT} {VERSION} has {', '.join(OWN_KEYS)}"
        )
    names = tuple(str(name) for name in np.atleast_1d(arrays["joint_names"]))
    if names != JOINT_NAMES:
        raise MotionFileError(f"'{path}' has joints {shortened(str(names), 200)}; they must be {JOINT_NAMES}")
    if arrays["sample_time"].shape != () or arrays["sample_time"] != SAMPLE_TIME:
        raise MotionFileError(f"'{path}' has sample_time {arrays['sample_time']}; it must be {SAMPLE_TIME} s")
    for key in ("q", "qd", "qdd"):
        if arrays[key].dtype.kind != "f":
            raise MotionFileError(f"'{path}': array '{key}' holds {arrays[key].dtype}; it must hold numbers")
    events = tuple(
        GripperEvent(e.time, e.dwell, GripperCommand(e.kind, e.width, e.force))
        for e in _parsed(path, "gripper", arrays, _EVENTS)
    )
    segments = tuple(
        TrajectorySegment(s.name, s.start, s.stop, s.held, s.touching, s.held_mass)
        for s in _parsed(path, "segments", arrays, _SEGMENTS)
    )
    try:
        trajectory = Trajectory(arrays["q"], arrays["qd"], arrays["qdd"], events, segments)
    except TrajectoryError as error:
        raise MotionFileError(f"'{path}': {error}") from error
    _refuse_stray_moments(path, trajectory)
    return trajectory, f"{FORMAT} {VERSION}"


def _parsed(path: Path, key: str, arrays: Mapping[str, np.ndarray], kind: TypeAdapter) -> tuple:
    try:
        return kind.validate_json(str(arrays[key]))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise MotionFileError(f"'{path}': {key}{'.' + place if place else ''}: {first['msg']}") from error


def _refuse_stray_moments(path: Path, trajectory: Trajectory) -> None:
    n, end = len(trajectory.q), 0
    for segment in trajectory.segments:
        if segment.start != end or segment.stop <= segment.start or segment.stop > n:
            raise MotionFileError(
                f"'{path}': segment '{shortened(segment.name)}' has samples {segment.start} to {segment.stop}; it must "
                f"start at {end}, where the one before it ends, and stop after that and by {n}"
            )
        end = segment.stop
    if trajectory.segments and end != n:
        raise MotionFileError(f"'{path}': the segments end at sample {end}; they must cover all {n}")
    for k, event in enumerate(trajectory.gripper):
        before = trajectory.gripper[k - 1].time if k else 0.0
        if not before <= event.time <= trajectory.duration:
            raise MotionFileError(
                f"'{path}': gripper event {k} is at {event.time:g} s; it must be between {before:g} s and the end at "
                f"{trajectory.duration:g} s"
            )
