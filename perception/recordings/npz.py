"""The project's own dump of frames: one .npz file, exact to the last bit."""

import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from perception.errors import FrameError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.recordings.base import Recording, Skipped, TruthOfFrame

NPZ_FORMAT = "rgbd-frames-1"


class NpzRecording(Recording):
    """Frames of the project's own .npz file, which `save_npz` writes.

    Args:
        path: The file.

    Raises:
        FrameError: It is damaged or is no dump of frames.
    """

    def __init__(self, path: Path) -> None:
        try:
            with np.load(path, allow_pickle=False) as data:
                if "format" not in data or str(data["format"]) != NPZ_FORMAT:
                    raise FrameError(f"'{path}' is not a dump of frames: its 'format' is not '{NPZ_FORMAT}'")
                count = int(data["count"])
        except (ValueError, OSError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise FrameError(f"'{path}' cannot be read as an .npz file: {error}") from error
        super().__init__(path.name, count)
        self._path = path

    def _items(self, with_truth: bool) -> Iterator[TruthOfFrame | Skipped]:
        assert self.count is not None
        with np.load(self._path, allow_pickle=False) as data:
            for i in range(self.count):
                try:
                    k = data[f"{i}/intrinsics"]
                    frame = RgbdFrame(
                        data[f"{i}/colour"],
                        data[f"{i}/depth"],
                        CameraIntrinsics(int(k[0]), int(k[1]), *(float(x) for x in k[2:6])),
                        data[f"{i}/world_T_camera"],
                        float(data[f"{i}/stamp"]),
                        str(data[f"{i}/camera"]),
                    )
                # zlib, the zip format and numpy meet damaged bytes with errors of half a dozen kinds
                except Exception as error:
                    yield Skipped(f"frame {i}", f"it is damaged: {error}")
                    continue
                yield TruthOfFrame(frame, None)


def save_npz(path: Path, frames: Sequence[RgbdFrame]) -> None:
    """Write frames to the project's own .npz file; `open_recording` reads it.

    Args:
        path: File to write, ending in .npz.
        frames: Any number, of any cameras.
    """
    arrays: dict[str, Any] = {"format": np.array(NPZ_FORMAT), "count": np.array(len(frames))}
    for i, frame in enumerate(frames):
        k = frame.intrinsics
        arrays[f"{i}/colour"], arrays[f"{i}/depth"] = frame.colour, frame.depth
        arrays[f"{i}/intrinsics"] = np.array([k.width, k.height, k.fx, k.fy, k.cx, k.cy], float)
        arrays[f"{i}/world_T_camera"] = frame.world_T_camera
        arrays[f"{i}/stamp"], arrays[f"{i}/camera"] = np.array(frame.stamp), np.array(frame.camera)
    np.savez_compressed(path, **arrays)
