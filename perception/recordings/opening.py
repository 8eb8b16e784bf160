"""Opening recorded RGB-D frames, whatever their format: PNG folders, BOP scenes, MCAP of ROS 2, the project's .npz."""

from pathlib import Path

from perception.errors import FrameError
from perception.recordings.base import Recording, Skipped, TruthOfFrame
from perception.recordings.bop import CAMERA_FILE, BopScene, scenes_below
from perception.recordings.mcap import McapRecording
from perception.recordings.mcap_choice import McapChoice
from perception.recordings.npz import NpzRecording, save_npz
from perception.recordings.png import PngFolder

__all__ = ["McapChoice", "Recording", "Skipped", "TruthOfFrame", "open_recording", "save_npz"]


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
        path: A folder of PNG pairs, a BOP scene folder, an MCAP file or a bag's folder with one, or an .npz file
            written by `save_npz`.
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
    lens = Path(intrinsics) if intrinsics is not None else None
    if path.is_dir() and (path / CAMERA_FILE).is_file():
        _refuse(path, "a BOP scene says its intrinsics itself", intrinsics=lens, mcap=mcap)
        return BopScene(path, depth_scale, _path(models), _path(object_names))
    bag = sorted(path.glob("*.mcap")) if path.is_dir() else []
    if len(bag) > 1:
        some = ", ".join(f"'{f.name}'" for f in bag[:5])
        raise FrameError(f"'{path}' is not one recording: it holds {len(bag)} MCAP files, {some}; name one of them")
    if bag:
        return open_recording(bag[0], lens, depth_scale, mcap=mcap, models=models, object_names=object_names)
    if path.is_dir():
        _refuse(path, "a folder of PNG pairs", mcap=mcap, models=models, object_names=object_names)
        scenes = scenes_below(path)
        if scenes and lens is None:
            some = ", ".join(f"'{s}'" for s in scenes[:5]) + (f" and {len(scenes) - 5} more" if len(scenes) > 5 else "")
            raise FrameError(
                f"'{path}' is not one recording: it holds {len(scenes)} BOP scenes, {some}; name one of them"
            )
        return PngFolder(path, lens, depth_scale)
    if not path.exists():
        raise FrameError(
            f"there is no recording '{path}'; give a folder of PNG pairs or a BOP scene, an .mcap or an .npz file"
        )
    if path.suffix.lower() == ".mcap":
        _refuse(path, "an MCAP file", models=models, object_names=object_names)
        return McapRecording(path, lens, depth_scale, mcap)
    if path.suffix.lower() in (".db3", ".bag"):
        raise FrameError(f"'{path}' is a bag of another format; convert it to MCAP, see docs/recordings.md")
    if path.suffix.lower() != ".npz":
        raise FrameError(f"'{path}' is neither a folder of PNG pairs or a BOP scene, nor an .mcap or an .npz file")
    _refuse(
        path,
        "a dump of frames says everything itself",
        intrinsics=lens,
        depth_scale=depth_scale,
        mcap=mcap,
        models=models,
        object_names=object_names,
    )
    return NpzRecording(path)


def _path(path: Path | str | None) -> Path | None:
    return None if path is None else Path(path)


def _refuse(path: Path, what: str, **options: object) -> None:
    """Refuse options that this kind of recording has no use for.

    Raises:
        FrameError: One was given.
    """
    for name, value in options.items():
        if value is not None:
            option = "options of MCAP topics" if name == "mcap" else f"--{name.replace('_', '-')}"
            raise FrameError(f"'{path}' has no use for {option}: {what}; leave it out")
