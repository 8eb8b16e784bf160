"""How a module of this program is run in a process of its own."""

import sys


def python_module(module: str, *arguments: str) -> list[str]:
    """The command line that runs a module with this Python.

    With -P, Python does not look into the folder where the user stands: one there that is named `control` or `planning`
    would hide ours.
    """
    return [sys.executable, "-P", "-m", module, *arguments]
