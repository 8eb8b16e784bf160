"""Opening recorded RGB-D frames, whatever their format: PNG folders, BOP scenes, MCAP of ROS 2, the project's .npz."""

from dataclasses import dataclass
from pathlib import Path

from perception.errors import FrameError
from perception.recording import Recording, Skipped, TruthOfFrame
from perception.recording_npz import NpzRecording, save_npz
from perception.recording_png import PngFolder

__all__ = ["McapChoice", "Recording", "Skipped", "TruthOfFrame", "open_recording", "save_npz"]


@dataclass(frozen=True)
class McapChoice:
    """What to read out of an MCAP file; the defaults find it.

    Attributes:
        colour, depth, info: Topics of one camera: its colour picture, its registered depth, its CameraInfo.
        cameras: Names of the cameras to read, as the notes of a recording name them; empty for all.
        world: Frame of the transforms that becomes the world.
        tolerance: Largest difference of the stamps of colour and depth in [s].
    """

    colour: str | None = None
    depth: str | None = None
    info: str | None = None
    cameras: tuple[str, ...] = ()
    world: str | None = None
    tolerance: float = 0.02


def open_recording(
    path: Path | str,
    intrinsics: Path | str | None = None,
    depth_scale: float | None = None,
    *,
    mcap: McapChoice | None = None,
    models: Path | str | None = None,
    object_names: Path | str | None = None,
) -> Recording:
    """Open recorded frames; iterate over the answer to read them one by one.

    Args:
        path: A folder of PNG pairs, a BOP scene folder, an MCAP file, or an .npz file written by `save_npz`.
        intrinsics: Intrinsics file, where the recording does not carry what the lens is.
        depth_scale: Metres per unit of whole-numbered depth, whatever the recording says.
        mcap: What to read out of an MCAP file.
        models: The models_info.json of a BOP data set, where it is not beside the scenes.
        object_names: YAML or JSON file with a name for each object id of a BOP data set.

    Returns:
        The recording. Its truth, where it has any, is for scorers only.

    Raises:
        FrameError: Nothing there, or nothing that can be read as frames; an option that the format has no use for.
            Single pictures that are broken do not raise: `Recording.skipped` names them.
    """
    path = Path(path)
    if path.is_dir():
        return PngFolder(path, Path(intrinsics) if intrinsics else None, depth_scale)
    if not path.exists():
        raise FrameError(
            f"there is no recording '{path}'; give a folder of PNG pairs or a BOP scene, an .mcap or an .npz file"
        )
    if path.suffix.lower() != ".npz":
        raise FrameError(f"'{path}' is neither a folder of PNG pairs or of a BOP scene, nor an .mcap or an .npz file")
    return NpzRecording(path)
