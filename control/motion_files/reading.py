"""Reading motion files of any format: ours, CSV, NPZ, MCAP. docs/motion-files.md describes them.

motion = read_motion(Path("motion.csv"))
trajectory = to_trajectory(motion)      # control.motion_files.resampling: as a robot would play it
path = to_path(motion)                  # control.motion_files.paths: without its times, to be retimed
"""

from pathlib import Path

from control.errors import MotionFileError
from control.motion_files.contents import MotionFile
from control.motion_files.csv_motions import read_csv
from control.motion_files.mcap_motions import read_mcap
from control.motion_files.npz_motions import read_npz

ENDINGS = (".npz", ".csv", ".mcap")


def read_motion(path: Path, topic: str | None = None, index: int | None = None) -> MotionFile:
    """Read a motion.

    Args:
        path: A file that ends in .npz (ours or arrays by name), .csv or .mcap (ROS 2).
        topic: Of an MCAP file with motions on more than one topic: which to read.
        index: Of a topic with more than one trajectory: which to read, from 0.

    Raises:
        MotionFileError: In one line, what is wrong with the file and what would be valid.
    """
    ending = path.suffix.lower()
    try:
        if path.is_dir():
            raise MotionFileError(f"'{path}' is a folder; give a motion file ({', '.join(ENDINGS)})")
        if not path.exists():
            raise MotionFileError(f"there is no file '{path}'; give a motion file ({', '.join(ENDINGS)})")
        if ending not in ENDINGS:
            raise MotionFileError(f"'{path}' is no known kind of motion file; valid endings are {', '.join(ENDINGS)}")
        if not path.is_file():
            raise MotionFileError(f"'{path}' is not an ordinary file; give a motion file ({', '.join(ENDINGS)})")
        with path.open("rb") as file:
            if not file.read(1):
                raise MotionFileError(f"'{path}' is empty; give a motion file ({', '.join(ENDINGS)})")
        if ending != ".mcap" and (topic is not None or index is not None):
            raise MotionFileError(f"'{path}' has no topics to choose from: topic and index are for .mcap files")
        if ending == ".csv":
            return read_csv(path)
        if ending == ".npz":
            return read_npz(path)
        return read_mcap(path, topic, index)
    except OSError as error:
        raise MotionFileError(f"'{path}' cannot be read: {error.strerror or error}") from error
