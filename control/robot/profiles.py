"""Robot profiles: published limits by name or from a file of one's own. Needs pydantic and YAML.

Known profiles lie in the folder profiles/, one YAML file each; a file of one's own looks the same.
"""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from control.errors import ConfigError
from control.robot.gripper import PANDA_HAND, GripperModel
from control.robot.limits import RobotLimits, VelocityEnds
from control.strict_yaml import read_mapping

FOLDER = Path(__file__).with_name("profiles")

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_SevenFinite = Annotated[tuple[_Finite, ...], Field(min_length=7, max_length=7)]
_SevenPositive = Annotated[tuple[_Positive, ...], Field(min_length=7, max_length=7)]


class _Strict(BaseModel):
    """Unknown keys are mistakes, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class _Ends(_Strict):
    """As `control.robot.limits.VelocityEnds`."""

    q_low: _SevenFinite
    q_high: _SevenFinite
    offset: _SevenPositive
    deceleration: _SevenPositive


class _Profile(_Strict):
    """As `control.robot.limits.RobotLimits`."""

    profile: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_.-]*/[0-9]+$")]
    firmware: Annotated[str, Field(min_length=1)]
    q_min: _SevenFinite
    q_max: _SevenFinite
    qd: _SevenPositive
    qdd: _SevenPositive
    qddd: _SevenPositive
    tau: _SevenPositive
    taud: _SevenPositive
    cartesian_speed: _Positive
    cartesian_acceleration: _Positive
    cartesian_jerk: _Positive
    angular_speed: _Positive
    angular_acceleration: _Positive
    angular_jerk: _Positive
    velocity_ends: _Ends | None = None

    @model_validator(mode="after")
    def _has_range(self) -> "_Profile":
        pairs = [("q_min", self.q_min, "q_max", self.q_max)]
        if self.velocity_ends is not None:
            pairs.append(("q_low", self.velocity_ends.q_low, "q_high", self.velocity_ends.q_high))
        for low_name, lows, high_name, highs in pairs:
            for joint, (low, high) in enumerate(zip(lows, highs, strict=True)):
                if low >= high:
                    raise ValueError(f"joint {joint + 1}: {low_name} is {low}, it must be below {high_name}, {high}")
        return self


def known_profiles() -> tuple[str, ...]:
    """Names of the profiles that come with the program."""
    return tuple(sorted(path.stem.replace("-", "/") for path in FOLDER.glob("*.yaml")))


def is_file_name(profile: str) -> bool:
    """Whether a cell file's profile names a file rather than a known profile."""
    return profile.endswith((".yaml", ".yml"))


def load_profile(name_or_path: str | Path, gripper: GripperModel = PANDA_HAND) -> RobotLimits:
    """Limits of a robot.

    Args:
        name_or_path: A name from `known_profiles`, or the path of a file (ending in .yaml or .yml).
        gripper: What the robot carries. The limits' profile names a gripper that is not the Panda's own hand, so that
            nothing planned for one gripper is played with another.

    Raises:
        ConfigError: No such profile or file, or a key or value that is not valid.
    """
    path = _path(name_or_path)
    content = read_mapping(path, "a robot profile", _Profile.model_fields)
    try:
        found = _Profile.model_validate(content)
    except ValidationError as error:
        raise ConfigError("\n".join(_explain(path, fault) for fault in error.errors())) from None
    values: dict[str, Any] = {name: np.array(v) if isinstance(v, tuple) else v for name, v in found}
    if found.velocity_ends is not None:
        values["velocity_ends"] = VelocityEnds(**{name: np.array(v) for name, v in found.velocity_ends})
    if gripper != PANDA_HAND:
        values["profile"] = f"{found.profile}+{gripper.name}"
    return RobotLimits(**values)


def _path(name_or_path: str | Path) -> Path:
    known = ", ".join(known_profiles())
    if isinstance(name_or_path, Path) or is_file_name(name_or_path):
        path = Path(name_or_path).expanduser()
        if not path.is_file():
            raise ConfigError(f"there is no robot profile '{path}'; known profiles are {known}")
        return path
    if name_or_path not in known_profiles():
        raise ConfigError(
            f"there is no robot profile '{name_or_path}'; known profiles are {known} (or give the path of a file "
            "ending in .yaml)"
        )
    return FOLDER / f"{name_or_path.replace('/', '-')}.yaml"


def _explain(path: Path, fault) -> str:
    """One fault: file, key, what was wrong, what would be valid."""
    where = ".".join(f"joint {part + 1}" if isinstance(part, int) else str(part) for part in fault["loc"])
    if fault["type"] == "extra_forbidden":
        model = _Ends if fault["loc"][0] == "velocity_ends" and len(fault["loc"]) > 1 else _Profile
        return f"{path}: unknown key '{where}'; valid keys there are {', '.join(model.model_fields)}"
    if fault["type"] == "missing":
        return f"{path}: key '{where}' is missing"
    if fault["type"] in ("too_short", "too_long"):
        return f"{path}: {where} needs 7 numbers, one for each joint, not {len(fault['input'])}"
    message = fault["msg"].removeprefix("Value error, ")
    return f"{path}: {where}: {message}" if where else f"{path}: {message}"
