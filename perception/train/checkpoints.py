"""Checkpoints of a training: written whole or not at all, and read back only where they fit."""

import os
from pathlib import Path
from typing import Any

from perception.detection.devices import load_package
from perception.errors import FrameError


def save_checkpoint(path: Path, parts: dict[str, Any], step: int, seconds: float) -> None:
    """Write the state of every part; an interruption leaves the checkpoint before.

    Args:
        path: File.
        parts: Models and optimisers, by name.
        step: Steps done.
        seconds: Time spent so far.
    """
    torch = load_package("torch")
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_suffix(".part")
    state = {name: part.state_dict() for name, part in parts.items()}
    torch.save({"step": step, "seconds": seconds, **state}, beside)
    os.replace(beside, path)


def load_checkpoint(path: Path, parts: dict[str, Any]) -> tuple[int, float]:
    """Put a checkpoint's state into the parts.

    Returns:
        Steps done and seconds spent; 0 and 0 when there is no checkpoint.

    Raises:
        FrameError: A damaged checkpoint, or one of another network.
    """
    torch = load_package("torch")
    if not path.exists():
        return 0, 0.0
    try:
        state = torch.load(path, weights_only=True)
        for name, part in parts.items():
            part.load_state_dict(state[name])
        return int(state["step"]), float(state["seconds"])
    except (RuntimeError, KeyError, ValueError, OSError, EOFError) as error:
        reason = str(error).strip().splitlines()[0]
        raise FrameError(
            f"the checkpoint '{path}' does not fit this training ({reason}); "
            "train with the settings that it was made with, or into another folder"
        ) from error
