"""Cells by name or file: built-in ones lie beside this module, one YAML file each.

Mistakes in a file are told by file, place and what would be valid there.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import yaml
from pydantic import BaseModel, ValidationError

from control.errors import ConfigError
from sim_check.cell_config import CameraConfig, CellConfig, DepthNoiseConfig, PlacementConfig, SimulationConfig

__all__ = [
    "DEFAULT_CELL",
    "CameraConfig",
    "CellConfig",
    "DepthNoiseConfig",
    "PlacementConfig",
    "SimulationConfig",
    "builtin_cells",
    "load_cell",
]

BUILTIN_FOLDER = Path(__file__).with_name("cells")
DEFAULT_CELL = "cubes"


class _StrictLoader(yaml.SafeLoader):
    """YAML's safe subset, in which a key given twice is a mistake instead of the last one winning."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen = set()
        for key, _ in node.value:
            name = self.construct_object(key, deep=True)
            if isinstance(name, str) and name in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key '{name}' is given twice", key.start_mark)
            seen.add(str(name))
        return super().construct_mapping(node, deep)


def builtin_cells() -> tuple[str, ...]:
    """Names of the cells that come with the program, the default one first."""
    names = sorted(path.stem for path in BUILTIN_FOLDER.glob("*.yaml"))
    return tuple(sorted(names, key=lambda n: n != DEFAULT_CELL))


def load_cell(name_or_path: str | Path = DEFAULT_CELL, options: Mapping[str, bool] | None = None) -> CellConfig:
    """Read a cell by the name of a built-in one or from a YAML file.

    Args:
        name_or_path: A name from `builtin_cells`, or a path (with a `/` or ending in .yaml or .yml).
        options: Switches to set; each must be one of the cell's options.

    Raises:
        ConfigError: No such cell or file, not YAML, or a key, value or option that is not valid.
    """
    path = _cell_path(name_or_path)
    content = _read_yaml(path)
    try:
        cell = CellConfig.model_validate(content)
    except ValidationError as error:
        raise ConfigError(_explain(path, error)) from None
    if not options:
        return cell
    for name, value in options.items():
        if name not in cell.options:
            raise ConfigError(f"cell '{cell.name}' has no option '{name}'; it has {sorted(cell.options) or 'none'}")
        if not isinstance(value, bool):
            raise ConfigError(f"option '{name}' of cell '{cell.name}' is a switch: true or false, not {value!r}")
    return cell.model_copy(update={"options": {**cell.options, **options}})


def _cell_path(name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    if isinstance(name_or_path, Path) or "/" in text or text.endswith((".yaml", ".yml")):
        path = Path(name_or_path).expanduser()
        if not path.is_file():
            raise ConfigError(f"there is no cell file '{path}'; built-in cells are {', '.join(builtin_cells())}")
        return path
    if text not in builtin_cells():
        raise ConfigError(
            f"there is no built-in cell '{text}'; built-in are {', '.join(builtin_cells())} "
            "(or give the path of a cell file ending in .yaml)"
        )
    return BUILTIN_FOLDER / f"{text}.yaml"


def _read_yaml(path: Path) -> Any:
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=_StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f":{mark.line + 1}" if mark else ""
        raise ConfigError(f"{path}{line}: not valid YAML ({error.problem or error.context})") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid YAML ({error})") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: a cell file is a mapping with the keys {', '.join(CellConfig.model_fields)}")
    return content


def _explain(path: Path, error: ValidationError) -> str:
    """One line per fault: file, key path, what was wrong, what would be valid."""
    lines = []
    for fault in error.errors():
        where = _key_path(fault["loc"])
        if fault["type"] == "extra_forbidden":
            valid = ", ".join(_valid_keys(fault["loc"][:-1]))
            lines.append(f"{path}: unknown key '{where}'; valid keys there are {valid}")
        elif fault["type"] == "missing":
            lines.append(f"{path}: key '{where}' is missing")
        else:
            message = fault["msg"].removeprefix("Value error, ")
            lines.append(f"{path}: {where}: {message}" if where else f"{path}: {message}")
    return "\n".join(lines)


def _key_path(loc: tuple[str | int, ...]) -> str:
    text = ""
    for part in loc:
        text += f"[{part}]" if isinstance(part, int) else f"{'.' if text else ''}{part}"
    return text


def _valid_keys(loc: tuple[str | int, ...]) -> list[str]:
    """Keys of the model that lies at a place in a cell file."""
    model: type[BaseModel] = CellConfig
    for part in loc:
        if isinstance(part, int):
            continue
        model = _model_in(model.model_fields[part].annotation) or model
    return list(model.model_fields)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (_model_in(a) for a in get_args(annotation))
    return next((m for m in found if m is not None), None)
