"""Motions from NPZ files: arrays by name. Nothing in them is ever unpickled.

    t               (n,)        or time, times: in [s]
    q               (n, 7)      or positions: in [rad], one column per name of joint_names
    joint_names     (7,)        strings, finger joints allowed too
    qd, qdd         (n, 7)      or velocities, accelerations; optional, in [rad/s] and [rad/s^2]
    gripper_width   (n,)        optional, in [m]
    gripper_force   (n,)        optional, in [N]

A file with a `format` is one of our own: see `control.motion_files.trajectory_file`.
"""

import zipfile
from pathlib import Path

import numpy as np

from control.errors import MotionFileError
from control.motion_files.contents import MAX_ROWS, MotionFile, checked
from control.motion_files.csv_motions import width_of_fingers
from control.motion_files.joint_names import find_joints
from control.motion_files.trajectory_file import OWN_KEYS, trajectory_of
from control.trajectory.samples import SAMPLE_TIME

ALIASES = {
    "t": ("t", "time", "times"),
    "q": ("q", "positions"),
    "qd": ("qd", "velocities"),
    "qdd": ("qdd", "accelerations"),
    "joint_names": ("joint_names",),
    "gripper_width": ("gripper_width",),
    "gripper_force": ("gripper_force",),
}
REQUIRED = ("t", "q", "joint_names")
MOST_BYTES = 64 * MAX_ROWS * 2  # of one array: seven joints and a finger of float64 take 64 bytes a row


def read_npz(path: Path) -> MotionFile:
    """Read a motion from an NPZ file, one of our own or anybody's.

    Raises:
        MotionFileError: Missing or unknown arrays, wrong shapes or types, numbers that cannot be used (by row from 0).
        OSError: The file cannot be opened or read.
    """
    arrays = _arrays(path)
    if "format" in arrays:
        trajectory, source = trajectory_of(path, arrays)
        n = len(trajectory.q)
        return checked(
            MotionFile(
                path=path,
                source=source,
                times=np.arange(n) * SAMPLE_TIME,
                q=trajectory.q,
                joint_names=trajectory.joint_names,
                row_word="row",
                row_numbers=np.arange(n),
                qd=trajectory.qd,
                qdd=trajectory.qdd,
                trajectory=trajectory,
            ),
            seconds=True,
        )
    named = _by_meaning(path, arrays)
    times = _floats(path, named, "t", 1)
    joints = find_joints(path, _names(path, named))
    n, columns = len(times), len(named["joint_names"][1])

    def of_arm(key: str) -> np.ndarray | None:
        table = _floats(path, named, key, 2, (n, columns)) if key in named else None
        return None if table is None else np.ascontiguousarray(table[:, joints.arm])

    def column(key: str) -> np.ndarray | None:
        return _floats(path, named, key, 1, (n,)) if key in named else None

    positions, width = _floats(path, named, "q", 2, (n, columns)), column("gripper_width")
    if joints.fingers:
        if width is not None:
            raise MotionFileError(f"'{path}' has both gripper_width and finger joints; give one of them")
        width = width_of_fingers(positions[:, joints.fingers])
    return checked(
        MotionFile(
            path=path,
            source="NPZ",
            times=times,
            q=np.ascontiguousarray(positions[:, joints.arm]),
            joint_names=joints.names,
            row_word="row",
            row_numbers=np.arange(n),
            qd=of_arm("qd"),
            qdd=of_arm("qdd"),
            gripper_width=width,
            gripper_force=column("gripper_force"),
        )
    )


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of a file; sizes and types are looked at before anything is loaded."""
    try:
        with zipfile.ZipFile(path) as archive:
            for name in archive.namelist():
                _refuse_by_header(path, archive, name)
        with np.load(path, allow_pickle=False) as data:
            return {key: data[key] for key in data.files}
    except (OSError, MotionFileError):
        raise
    except Exception as error:  # zipfile, zlib and numpy meet damaged bytes with errors of a dozen kinds
        raise MotionFileError(
            f"'{path}' cannot be read as an NPZ file (a zip archive of arrays): it is damaged or something else "
            f"({type(error).__name__})"
        ) from error


def _refuse_by_header(path: Path, archive: zipfile.ZipFile, name: str) -> None:
    """Refuse an array that is pickled or too large, by its header alone."""
    key = name.removesuffix(".npy")
    with archive.open(name) as member:
        version = np.lib.format.read_magic(member)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(member)
    if dtype.hasobject:
        raise MotionFileError(
            f"'{path}': array '{key}' holds pickled objects, which are never loaded, as they could run a program; save "
            "arrays of numbers and strings"
        )
    if any(count < 0 for count in shape) or dtype.itemsize * float(np.prod([float(c) for c in shape])) > MOST_BYTES:
        raise MotionFileError(
            f"'{path}': array '{key}' has shape {shape}; a motion has at most {MAX_ROWS} rows: cut it into shorter ones"
        )


def _by_meaning(path: Path, arrays: dict[str, np.ndarray]) -> dict[str, tuple[str, np.ndarray]]:
    """Arrays by what they hold, with the name that they have in the file."""
    valid = "; ".join(
        " or ".join(names) + ("" if meaning in REQUIRED else " (optional)") for meaning, names in ALIASES.items()
    )
    named: dict[str, tuple[str, np.ndarray]] = {}
    for key, array in arrays.items():
        meaning = next((m for m, names in ALIASES.items() if key in names), None)
        if meaning is None:
            raise MotionFileError(f"'{path}' has an unknown array '{key}'; valid are {valid}")
        if meaning in named:
            raise MotionFileError(f"'{path}' has both '{named[meaning][0]}' and '{key}'; give one of them")
        named[meaning] = (key, array)
    missing = [" or ".join(ALIASES[meaning]) for meaning in REQUIRED if meaning not in named]
    if missing:
        own = f"; or all of our own format's: {', '.join(OWN_KEYS)}" if "joint_names" not in named else ""
        raise MotionFileError(f"'{path}' lacks {', '.join(missing)}; valid are {valid}{own}")
    return named


def _floats(
    path: Path,
    named: dict[str, tuple[str, np.ndarray]],
    meaning: str,
    dimensions: int,
    shape: tuple[int, ...] | None = None,
) -> np.ndarray:
    key, array = named[meaning]
    if array.dtype.kind not in "fiu":
        raise MotionFileError(f"'{path}': array '{key}' holds {array.dtype}; it must hold numbers")
    if array.ndim != dimensions or (shape is not None and array.shape != shape):
        needs = f"{shape}: rows of '{named['t'][0]}'" + (", columns of joint_names" if dimensions == 2 else "")
        raise MotionFileError(
            f"'{path}': array '{key}' has shape {array.shape}; it needs {needs if shape else '(n,), one time a row'}"
        )
    return np.array(array, dtype=np.float64)


def _names(path: Path, named: dict[str, tuple[str, np.ndarray]]) -> list[str]:
    names = named["joint_names"][1]
    if names.ndim != 1 or names.dtype.kind not in "US":
        raise MotionFileError(
            f"'{path}': joint_names is {names.dtype} of shape {names.shape}; it needs one string per column of q"
        )
    return [name.decode("utf-8", "replace") if isinstance(name, bytes) else str(name) for name in names]
