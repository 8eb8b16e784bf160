"""Motions from CSV files: a header line, then one line a row, separated by commas.

    t,panda_joint1,..,panda_joint7[,panda_joint1_velocity,..][,panda_joint1_acceleration,..][,gripper_width]

Columns in any order; lines that begin with # are comments.
"""

import csv
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from control.errors import MotionFileError
from control.motion_files.contents import MAX_DURATION, MAX_ROWS, MotionFile, checked
from control.motion_files.joint_names import JointColumns, find_joints, is_joint, shortened

MAX_LINE = 20_000  # characters
TIME_COLUMNS = ("t", "time", "time_from_start")
GRIPPER_COLUMNS = ("gripper_width", "gripper_force")
DERIVATIVES = ("_velocity", "_acceleration")
VALID_COLUMNS = (
    "valid are a time column (t, time or time_from_start), panda_joint1 .. panda_joint7 (or fr3_joint1 .., or joint1 "
    "..), each with _velocity or _acceleration behind it, panda_finger_joint1, 2, gripper_width and gripper_force"
)


@dataclass(frozen=True)
class _Header:
    """Which column holds what; empty tuples and None where nothing does."""

    names: tuple[str, ...]
    time: int
    joints: JointColumns
    velocities: tuple[int, ...]
    accelerations: tuple[int, ...]
    width: int | None
    force: int | None


def read_csv(path: Path) -> MotionFile:
    """Read a motion from a CSV file; units and names stand in docs/motion-files.md.

    Raises:
        MotionFileError: A header, line or number that cannot be used, by line and column.
        OSError: The file cannot be opened or read.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = _lines(path, file)
            number, line = next(lines, (0, ""))
            if not number:
                raise MotionFileError(f"'{path}' is empty; it needs a header line: {VALID_COLUMNS}")
            header = _header(path, number, line)
            numbers, rows = _rows(path, header, lines)
    except UnicodeDecodeError as error:
        raise MotionFileError(f"'{path}' is not a text file ({error.reason}); save it as UTF-8") from error

    def columns(which: tuple[int, ...]) -> np.ndarray | None:
        return np.ascontiguousarray(rows[:, which]) if which else None

    width = None
    if header.width is not None:
        width = rows[:, header.width].copy()
    elif header.joints.fingers:
        width = width_of_fingers(rows[:, header.joints.fingers])
    return checked(
        MotionFile(
            path=path,
            source="CSV",
            times=rows[:, header.time].copy(),
            q=np.ascontiguousarray(rows[:, header.joints.arm]),
            joint_names=header.joints.names,
            row_word="line",
            row_numbers=numbers,
            qd=columns(header.velocities),
            qdd=columns(header.accelerations),
            gripper_width=width,
            gripper_force=None if header.force is None else rows[:, header.force].copy(),
        ),
    )


def width_of_fingers(fingers: np.ndarray) -> np.ndarray:
    """Distance between the pads in [m], shape (n,), from finger positions in [m], shape (n, 1 or 2).

    One finger alone stands for both: they move alike.
    """
    return fingers.sum(axis=1) * (2.0 / fingers.shape[1])


def _lines(path: Path, file: TextIO) -> Iterator[tuple[int, str]]:
    """Numbered lines that hold something; never reads more than MAX_LINE characters at once."""
    number = 0
    while line := file.readline(MAX_LINE + 1):
        number += 1
        if len(line) > MAX_LINE:
            raise MotionFileError(f"'{path}', line {number} has more than {MAX_LINE} characters; is this a CSV file?")
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line


def _cells(path: Path, number: int, line: str) -> list[str]:
    try:
        return next(csv.reader([line], strict=True, skipinitialspace=True))
    except csv.Error as error:
        raise MotionFileError(f"'{path}', line {number} is not valid CSV: {error}") from error


def _header(path: Path, number: int, line: str) -> _Header:
    names = tuple(cell.strip() for cell in _cells(path, number, line))
    if len(names) == 1 and any(mark in line for mark in ";\t"):
        raise MotionFileError(f"'{path}', line {number}: columns must be separated by commas, not ';' or tabs")
    if all(_is_number(name) for name in names):
        raise MotionFileError(
            f"'{path}', line {number} holds numbers where a header is needed (one that begins with # is a comment); "
            f"{VALID_COLUMNS}"
        )
    for k, name in enumerate(names):
        base = _joint_of(name)
        if name not in TIME_COLUMNS and name not in GRIPPER_COLUMNS and base is None:
            raise MotionFileError(f"'{path}', line {number}: unknown column '{shortened(name)}'; {VALID_COLUMNS}")
        if name in names[:k]:
            raise MotionFileError(f"'{path}', line {number}: column '{name}' stands there twice")
    times = [k for k, name in enumerate(names) if name in TIME_COLUMNS]
    if len(times) != 1:
        has = "no time column" if not times else f"{len(times)} time columns"
        raise MotionFileError(f"'{path}', line {number} has {has}; it needs one of {', '.join(TIME_COLUMNS)}, in [s]")
    places = [k for k, name in enumerate(names) if is_joint(name)]
    joints = find_joints(path, [names[k] for k in places])
    width = names.index("gripper_width") if "gripper_width" in names else None
    if width is not None and joints.fingers:
        raise MotionFileError(f"'{path}', line {number} has both gripper_width and finger joints; give one of them")
    arm, fingers = (tuple(places[k] for k in which) for which in (joints.arm, joints.fingers))
    return _Header(
        names=names,
        time=times[0],
        joints=JointColumns(arm, fingers, joints.names),
        velocities=_derivative(path, number, names, joints.names, "_velocity"),
        accelerations=_derivative(path, number, names, joints.names, "_acceleration"),
        width=width,
        force=names.index("gripper_force") if "gripper_force" in names else None,
    )


def _joint_of(column: str) -> str | None:
    """The joint that a column belongs to, by itself or as an arm joint's derivative; None for other columns."""
    if is_joint(column):
        return column
    for ending in DERIVATIVES:
        base = column.removesuffix(ending)
        if base != column and is_joint(base) and "finger" not in base:
            return base
    return None


def _derivative(
    path: Path, number: int, names: tuple[str, ...], joints: tuple[str, ...], ending: str
) -> tuple[int, ...]:
    """Columns of the joints' velocities or accelerations, in the robot's order; empty when there are none."""
    wanted = [joint + ending for joint in joints]
    missing = [name for name in wanted if name not in names]
    given = [name for name in names if name.endswith(ending)]
    if not given:
        return ()
    if missing or len(given) > len(wanted):
        odd = missing[0] if missing else next(name for name in given if name not in wanted)
        raise MotionFileError(
            f"'{path}', line {number}: columns that end in {ending} must be {wanted[0]} .. {wanted[-1]}, or none at "
            f"all; '{odd}' is {'missing' if missing else 'not one of them'}"
        )
    return tuple(names.index(name) for name in wanted)


def _rows(path: Path, header: _Header, lines: Iterator[tuple[int, str]]) -> tuple[np.ndarray, np.ndarray]:
    """Line numbers and values, shape (n, columns); stops after the first row too many, which `checked` refuses."""
    count = len(header.names)
    numbers, values = array("q"), array("d")
    latest = np.inf
    for number, line in lines:
        cells = _cells(path, number, line)
        if len(cells) != count:
            raise MotionFileError(f"'{path}', line {number} has {len(cells)} columns, the header has {count}")
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            k = next(k for k, cell in enumerate(cells) if not _is_number(cell))
            what = f"'{shortened(cells[k])}' is not a number" if cells[k].strip() else "there is no number"
            raise MotionFileError(f"'{path}', line {number}, column '{header.names[k]}': {what}") from None
        numbers.append(number)
        values.extend(row)
        if len(numbers) == 1:
            latest = row[header.time] + MAX_DURATION
        if row[header.time] > latest or len(numbers) > MAX_ROWS:
            break
    return np.array(numbers, dtype=np.int64), np.array(values, dtype=float).reshape(-1, count)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
