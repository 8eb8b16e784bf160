"""Whether MuJoCo can be imported at all: its rendering is chosen while it is imported, and may fail right there."""

import os

from control.errors import MachineError
from replan_base.parts import install_part


def require_mujoco() -> None:
    """Import MuJoCo, or say in one line why its rendering cannot be loaded.

    Raises:
        MachineError: The rendering backend that MUJOCO_GL asks for does not load, or MuJoCo is not installed.
    """
    try:
        import mujoco  # noqa: F401
    except ModuleNotFoundError as error:
        raise MachineError(f"{error.name} is not installed in this environment; run: {install_part('twin')}") from error
    except Exception as error:  # PyOpenGL fails in many ways when a library is absent, AttributeError among them
        wanted = os.environ.get("MUJOCO_GL", "")
        asked = f"MUJOCO_GL={wanted} does not load here" if wanted else "MuJoCo's rendering does not load here"
        raise MachineError(
            f"{asked} ({type(error).__name__}: {error}); set MUJOCO_GL=egl and run: "
            "sudo apt-get install libegl1 libgl1 libgl1-mesa-dri"
        ) from error
