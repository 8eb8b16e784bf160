"""Where the Panda's description lies: the URDF and meshes of the example-robot-data package."""

import importlib.metadata
from pathlib import Path

from control.errors import ConfigError


def panda_description() -> Path:
    """Folder of the Panda's description (urdf/, meshes/).

    Raises:
        ConfigError: The package example-robot-data is not installed in this environment.
    """
    # Its Python module may fail to import, so its files are located through the package's own file list.
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    for file in files:
        if file.name == "panda.urdf":
            return Path(str(file.locate())).resolve().parents[1]
    raise ConfigError("the Panda's URDF was not found; install example-robot-data, which comes with this program")


def panda_urdf() -> Path:
    """Path of panda.urdf."""
    return panda_description() / "urdf" / "panda.urdf"
