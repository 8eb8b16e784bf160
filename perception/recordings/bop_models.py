"""What a BOP data set says about its objects: sizes, symmetries and, in a file of names, what they are called.

models_info.json has for each object id, in [mm], the bounding box of its model (min_x, size_x, ...) and its symmetries.
A file of names (YAML or JSON) maps ids to names: {1: master chef can, 5: mustard bottle}.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from perception.errors import FrameError

MM = 0.001  # [m]
NAMES_BESIDE = ("names.json", "names.yaml", "names.yml")  # looked for beside models_info.json


@dataclass(frozen=True)
class BopModel:
    """One object of the data set.

    Attributes:
        extents: Full sizes of the box around its model along the model's axes in [m], shape (3,).
        centre: Centre of that box in the model's frame in [m], shape (3,).
        round_about: Axis of a continuous symmetry in the model's frame, unit length, shape (3,); or None.
        turns: Further poses, model_T_model, in which it looks the same, each of shape (4, 4).
    """

    extents: NDArray[np.float64]
    centre: NDArray[np.float64]
    round_about: NDArray[np.float64] | None = None
    turns: tuple[np.ndarray, ...] = ()


def find_models(scene: Path) -> Path | None:
    """The models_info.json that belongs to a scene folder: in the folders models* of its parent or grandparent."""
    for root in (scene.resolve().parent, scene.resolve().parent.parent):
        for folder in ("models", "models_eval", "models_cad"):
            if (root / folder / "models_info.json").is_file():
                return root / folder / "models_info.json"
    return None


def read_models(file: Path) -> dict[int, BopModel]:
    """Objects by id.

    Raises:
        FrameError: The file cannot be read or lacks a size (names the object).
    """
    models = {}
    for key, info in read_json(file).items():
        try:
            low = np.array([info[f"min_{a}"] for a in "xyz"], float)
            size = np.array([info[f"size_{a}"] for a in "xyz"], float)
            turns = tuple(np.array(t, float).reshape(4, 4) for t in info.get("symmetries_discrete", []))
            continuous = info.get("symmetries_continuous", [])
            axis = np.array(continuous[0]["axis"], float) if continuous else None
            number = int(key)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise FrameError(
                f"object '{key}' of '{file}' is not valid: {type(error).__name__} {error}; it needs min_x, min_y, "
                "min_z, size_x, size_y and size_z in [mm]"
            ) from error
        for t in turns:
            t[:3, 3] *= MM
        models[number] = BopModel(size * MM, (low + size / 2) * MM, axis, turns)
    return models


def read_names(file: Path) -> dict[int, str]:
    """Names by object id, in lower case with underscores.

    Raises:
        FrameError: The file cannot be read, or is no mapping of whole numbers to names.
    """
    try:
        text = file.read_text(encoding="utf-8")
        data = json.loads(text) if file.suffix.lower() == ".json" else yaml.safe_load(text)
        names = {int(k): str(v).strip().lower().replace(" ", "_") for k, v in data.items()}
    except (OSError, ValueError, AttributeError, yaml.YAMLError) as error:
        raise FrameError(
            f"the file of object names '{file}' is not valid: {error}; it maps ids to names, "
            "for instance {1: red cube, 2: crate}"
        ) from error
    twice = sorted({n for n in names.values() if not n or list(names.values()).count(n) > 1})
    if twice:
        raise FrameError(f"the file of object names '{file}' has no name for an id, or '{twice[0]}' for several")
    return names


def find_names(models: Path | None) -> Path | None:
    """A file of names beside a models_info.json, if there is one."""
    if models is None:
        return None
    return next((models.parent / n for n in NAMES_BESIDE if (models.parent / n).is_file()), None)


def name_of(number: int, names: dict[int, str]) -> str:
    """Name of an object id; for instance obj_000005 where nobody gave one."""
    return names.get(number, f"obj_{number:06d}")


def read_json(file: Path) -> dict[str, Any]:
    """A JSON file that holds an object.

    Raises:
        FrameError: It cannot be read, or holds something else.
    """
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FrameError(f"'{file}' cannot be read: {error}") from error
    if not isinstance(data, dict):
        raise FrameError(f"'{file}' is not a BOP file: it holds a {type(data).__name__}, not an object by number")
    return data
