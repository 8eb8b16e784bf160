"""The parts of an installation that may be absent, and what to type to get one.

A part is an extra of the package (`pip install 'replan[twin]'`); a checkout has all of them after `make setup`.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

from replan_base.errors import MissingPartError
from replan_base.packages import ROOT

# Top-level module of each package that is not always there, and the part that it comes with.
PART_OF = MappingProxyType(
    {
        "collada": "twin",
        "cryptography": "security",
        "cv2": "twin",
        "huggingface_hub": "perception",
        "matplotlib": "twin",
        "mcap": "twin",
        "mcap_ros2": "twin",
        "mujoco": "twin",
        "open3d": "perception",
        "openai": "models",
        "panda_py": "panda",
        "pymodbus": "robotiq",
        "pyperplan": "baselines",
        "pyrealsense2": "cameras",
        "ray": "cluster",
        "rosbags": "ros2",
        "serial": "robotiq",
        "toppra": "twin",
        "torch": "perception",
        "transformers": "perception",
        "trimesh": "twin",
        "unified_planning": "baselines",
        "up_pyperplan": "baselines",
    }
)
ROBOT_SIDE = ("panda", "robotiq", "ros2", "security")  # what `make setup-robot` installs as well


def install_part(part: str, root: Path = ROOT) -> str:
    """What to type to get a part: `make` in a checkout, `pip` where a wheel is installed.

    Args:
        part: An extra of the package.
        root: The folder that holds the packages.
    """
    if not (root / "pyproject.toml").is_file():
        return f"pip install 'replan[{part}]'"
    return "make setup" + (", or make setup-robot" if part in ROBOT_SIDE else "")


@contextmanager
def missing_parts_named() -> Iterator[None]:
    """Turn the failed import of a package that may be absent into one line.

    Raises:
        MissingPartError: Says which package, and what to type; other failed imports pass untouched.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        if module not in PART_OF:
            raise
        raise MissingPartError(
            f"this needs the package {module}, which is not installed; run: {install_part(PART_OF[module])}"
        ) from error
