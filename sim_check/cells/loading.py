"""Cells by name or file: built-in ones lie beside this module, one YAML file each.

Mistakes in a file are told by file, place and what would be valid there.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from control.errors import ConfigError
from control.robot.profiles import is_file_name
from control.strict_yaml import read_mapping
from sim_check.cells.cell_config import CameraConfig, CellConfig, DepthNoiseConfig, PlacementConfig, SimulationConfig
from sim_check.cells.furniture_config import furniture_kinds

__all__ = [
    "DEFAULT_CELL",
    "CameraConfig",
    "CellConfig",
    "DepthNoiseConfig",
    "PlacementConfig",
    "SimulationConfig",
    "builtin_cells",
    "explain_fault",
    "load_cell",
]

BUILTIN_FOLDER = Path(__file__).with_name("builtin")
DEFAULT_CELL = "cubes"


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
        ConfigError: No such cell, file or robot profile, not YAML, or a key, value or option that is not valid.
    """
    path = _cell_path(name_or_path)
    content = read_mapping(path, "a cell file", CellConfig.model_fields)
    try:
        cell = CellConfig.model_validate(content)
    except ValidationError as error:
        raise ConfigError(explain_fault(path, error, CellConfig)) from None
    cell = _with_profile(cell, path)
    if not options:
        return cell
    for name, value in options.items():
        if name not in cell.options:
            raise ConfigError(f"cell '{cell.name}' has no option '{name}'; it has {sorted(cell.options) or 'none'}")
        if not isinstance(value, bool):
            raise ConfigError(f"option '{name}' of cell '{cell.name}' is a switch: true or false, not {value!r}")
    return cell.model_copy(update={"options": {**cell.options, **options}})


def _with_profile(cell: CellConfig, path: Path) -> CellConfig:
    """The cell with its robot profile found: a file is looked for from the folder of the cell file."""
    if is_file_name(cell.robot.profile):
        found = path.parent / Path(cell.robot.profile).expanduser()
        cell = cell.model_copy(update={"robot": cell.robot.model_copy(update={"profile": str(found)})})
    try:
        cell.robot.limits()
    except ConfigError as error:
        raise ConfigError(f"{path}: robot.profile: {error}") from None
    return cell


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


def explain_fault(path: Path, error: ValidationError, model: type[BaseModel]) -> str:
    """One line per fault of a strict file: file, key path, what was wrong, what would be valid.

    Args:
        path: The file.
        error: What pydantic said of its content.
        model: What the content was held against.
    """
    lines = []
    for fault in error.errors():
        where, _ = _follow(fault["loc"], model)
        if fault["type"] == "extra_forbidden":
            _, owner = _follow(fault["loc"][:-1], model)
            lines.append(f"{path}: unknown key '{where}'; valid keys there are {', '.join(_keys(owner))}")
        elif fault["type"] == "missing":
            lines.append(f"{path}: key '{where}' is missing")
        elif fault["type"] in ("union_tag_invalid", "union_tag_not_found"):
            tag = fault.get("ctx", {}).get("tag")
            said = "key 'kind' is missing" if tag is None else f"there is no kind '{tag}'"
            lines.append(f"{path}: {where}: {said}; kinds are {', '.join(furniture_kinds())}")
        else:
            message = fault["msg"].removeprefix("Value error, ")
            lines.append(f"{path}: {where}: {message}" if where else f"{path}: {message}")
    return "\n".join(lines)


def _follow(loc: tuple[str | int, ...], model: type[BaseModel]) -> tuple[str, Any]:
    """Key path of a fault's place as a person would write it, and the type of what lies there."""
    text, here = "", model
    for part in loc:
        here = _without_none(here)
        kinds = [m for m in get_args(here) if _is_model(m) and part in get_args(_field(m, "kind"))]
        if kinds:  # which kind it is stands beside the keys, not above them
            here = kinds[0]
            continue
        text += f"[{part}]" if isinstance(part, int) else f"{'.' if text else ''}{part}"
        if _is_model(here):
            here = _field(here, part)
        else:
            items = [a for a in get_args(here) if a is not Ellipsis]
            here = items[-1] if items else None
    return text, here


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _field(model: Any, name: str | int) -> Any:
    field = model.model_fields.get(name)
    return None if field is None else field.annotation


def _without_none(annotation: Any) -> Any:
    """What an annotation says, apart from constraints and from that it may be left out."""
    while get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    options = [a for a in get_args(annotation) if a is not type(None)]
    optional = len(options) == 1 and len(get_args(annotation)) == 2
    return _without_none(options[0]) if optional else annotation


def _keys(annotation: Any) -> list[str]:
    model = _without_none(annotation)
    return list(model.model_fields) if _is_model(model) else []
