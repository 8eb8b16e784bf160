"""Names of joints in motion files: which columns are the arm's, in the robot's order, and which are the fingers'.

ROS drivers name the same seven joints in three ways: panda_joint1, fr3_joint1 (the Panda's successor, whose joints
turn alike) and joint1. A file keeps to one of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from control.errors import MotionFileError

PREFIXES = ("panda_", "fr3_", "")
ARM = tuple(f"joint{i}" for i in range(1, 8))
FINGER = ("finger_joint1", "finger_joint2")
VALID_JOINTS = "panda_joint1 .. panda_joint7 (or fr3_joint1 .., or joint1 ..) and panda_finger_joint1, 2"


@dataclass(frozen=True)
class JointColumns:
    """Where the joints of a file stand.

    Attributes:
        arm: Column of each arm joint, in the robot's order; seven.
        fingers: Columns of the finger joints, none to two; a finger's position is its distance from the middle in [m].
        names: The arm joints' names in the file, in the robot's order.
    """

    arm: tuple[int, ...]
    fingers: tuple[int, ...]
    names: tuple[str, ...]


def is_joint(name: str) -> bool:
    """Whether a name is one of an arm or finger joint."""
    return any(name == prefix + joint for prefix in PREFIXES for joint in (*ARM, *FINGER))


def find_joints(path: Path, names: Sequence[str]) -> JointColumns:
    """The columns of the robot's joints.

    Args:
        path: The file, for errors.
        names: Joint names in the order of its columns.

    Raises:
        MotionFileError: An unknown name, one that stands there twice or is missing, or names of two kinds.
    """
    for k, name in enumerate(names):
        if not is_joint(name):
            raise MotionFileError(f"'{path}' has a joint '{shortened(name)}'; valid are {VALID_JOINTS}")
        if name in names[:k]:
            raise MotionFileError(f"'{path}' has joint '{name}' twice; each joint may stand there once")
    found = {prefix for prefix in PREFIXES for name in names if name in {prefix + joint for joint in (*ARM, *FINGER)}}
    if len(found) > 1:
        kinds = " and ".join(f"'{prefix}joint..'" for prefix in sorted(found))
        raise MotionFileError(f"'{path}' mixes joint names {kinds}; use one kind for all joints")
    prefix = found.pop() if found else PREFIXES[0]
    missing = [prefix + joint for joint in ARM if prefix + joint not in names]
    if missing:
        has = f"it has {len(ARM) - len(missing)} of the arm's 7 joints"
        raise MotionFileError(f"'{path}' lacks joint {', '.join(missing)}; {has}, and all 7 are needed")
    ordered = tuple(prefix + joint for joint in ARM)
    fingers = tuple(names.index(prefix + joint) for joint in FINGER if prefix + joint in names)
    return JointColumns(tuple(names.index(name) for name in ordered), fingers, ordered)


def shortened(text: str, length: int = 40) -> str:
    """Somebody else's text, fit for one line of an error: printable, and not longer than `length` characters."""
    text = "".join(c if c.isprintable() else "?" for c in text[: length + 1])
    return text if len(text) <= length else text[: length - 2] + ".."
