"""Keys by which files that belong to single frames of a recording name them."""

import re
from pathlib import Path

from perception.recordings.base import Recording
from perception.recordings.bop import CAMERA_FILE, BopScene, by_number
from perception.recordings.png import find_pairs


def frame_keys(path: Path, recording: Recording) -> tuple[str, ...] | None:
    """The key of each frame in the recording's order, broken ones among them.

    Where the number of frames is unknown (MCAP) it is None: frames are numbered as they are read, from 0.
    Pictures of a BOP scene are named by their number in six digits ("000003").
    Frames of a folder of PNG pairs are named like their depth file up to the word depth ("000002-depth.png" is
    "000002", "depth/0007.png" is "0007"); where that does not tell them apart, and in any other recording, frames are
    numbered from 0: "0", "1", ...

    Args:
        path: The recording.
        recording: The same, opened.
    """
    if recording.count is None:
        return None
    if isinstance(recording, BopScene):
        return tuple(f"{number:06d}" for number in sorted(by_number(path / CAMERA_FILE)))
    if path.is_dir():
        names = [key_of_depth_file(depth) for _, depth in find_pairs(path)]
        if len(set(names)) == len(names) == recording.count and all(names):
            return tuple(names)
    return tuple(str(i) for i in range(recording.count))


def key_of_depth_file(file: Path) -> str:
    """What a depth picture is called before the word depth, or behind it, or without it."""
    before, _, behind = re.sub("depth", "\0", file.stem, count=1, flags=re.IGNORECASE).partition("\0")
    return before.strip("-_. ") or behind.strip("-_. ")
