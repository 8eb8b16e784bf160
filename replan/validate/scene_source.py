"""Where a scene comes from when nobody looks: a cell's own poses, a scene file, or what was perceived before."""

import json
import time
from pathlib import Path

from pydantic import ValidationError

from control.errors import ConfigError
from control.strict_yaml import read_mapping
from perception.errors import FrameError
from perception.estimates import SceneEstimate
from perception.scene_file import read_perception_result
from sim_check.cells.loading import CellConfig, explain_fault
from sim_check.cells.poses_config import SceneConfig
from sim_check.twin.fixed_poses import fixed_scene

LOOKS = "objects_*.json"  # in a run's folder, one a look


def scene_for(cell: CellConfig, source: Path | None, frame: int = -1) -> SceneEstimate:
    """The scene that a motion is judged in.

    Args:
        cell: For its poses and its furniture.
        source: A scene file (YAML: table, poses), what `replan perceive` wrote (objects.json or its folder), or a
            run's folder (its looks, in order); None takes the poses of the cell file.
        frame: Which look of several, counted from 0, or from the last one with -1.

    Raises:
        ConfigError: The cell has no poses, or the file is missing or not valid; says what would be.
        FrameError: A perception result that is not valid, or a look that it does not have.
    """
    if source is None:
        if not cell.poses:
            raise ConfigError(
                f"cell '{cell.name}' says nothing about where things stand; add `poses` to its file, or give --scene "
                "(a scene file, or what `replan perceive` or a run wrote)"
            )
        return fixed_scene(cell.poses, cell.furniture, 0.0, time.time())
    path = _file(source, frame)
    if path.suffix in (".yaml", ".yml"):
        content = read_mapping(path, "a scene file", SceneConfig.model_fields)
    else:
        content = _read_json(path)
    if isinstance(content, dict) and "frames" in content:
        return read_perception_result(path, content).scene(-1 if path.parent == source and path.match(LOOKS) else frame)
    try:
        scene = SceneConfig.model_validate(content)
    except ValidationError as error:
        raise ConfigError(explain_fault(path, error, SceneConfig)) from None
    try:
        return fixed_scene(scene.poses, cell.furniture, scene.table, time.time())
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def _read_json(path: Path):
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise ConfigError(f"{path}: not valid JSON ({error})") from None


def _file(source: Path, frame: int) -> Path:
    """The file to read; of a run's folder the look that is asked for."""
    if source.is_file():
        return source
    if not source.exists():
        raise ConfigError(
            f"there is no scene file '{source}'; it is YAML (table, poses) or what `replan perceive` wrote"
        )
    if (source / "objects.json").is_file():
        return source / "objects.json"
    looks = sorted(source.glob(LOOKS))
    if not looks:
        raise ConfigError(f"{source}: neither objects.json nor {LOOKS} is in this folder; was nothing perceived?")
    if not -len(looks) <= frame < len(looks):
        raise FrameError(f"there is no look {frame}; {source} has {len(looks)} looks, counted from 0")
    return looks[frame]
