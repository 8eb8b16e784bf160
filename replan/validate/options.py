"""What a validation can be asked for, and how what a person typed becomes it."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite, pi
from pathlib import Path
from typing import TYPE_CHECKING

from control.errors import ConfigError
from replan.options import CellOptions

if TYPE_CHECKING:
    import numpy as np

    from control.robot.dynamics import Payload

HEAVIEST = 50.0  # [kg]; far beyond what any arm here carries: a larger number is a mistake
Joints = tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class RetimeOptions:
    """Whether a motion is retimed first."""

    retime: bool = False
    """Retime the path first, and judge the result."""
    fraction: float | None = None
    """With --retime: share of the published speeds and accelerations to use; default: what the cell allows."""
    tolerance_mrad: float = 4.0
    """With --retime: how far a joint may leave the path, in [mrad]."""


@dataclass(frozen=True, kw_only=True)
class HandlingOptions:
    """What the motion does to things, and what it carries."""

    handles: tuple[str, ...] = ()
    """Objects that the hand grasps, in that order. Nothing else may be touched or moved, unless --touches names it."""
    touches: tuple[str, ...] = ()
    """Other objects or joints that may be touched and moved: what something is put down on, a door."""
    held: str | None = None
    """Object that is in the hand from the start."""
    gripper_width: float | None = None
    """Distance between the pads at the start in [m]; default: the file's, or open."""
    reward: str | None = None
    """What it should achieve, as reward calls, or a file with them; default: only safety is judged."""
    payload_kg: float = 0.0
    """Mass in the hand that the scene does not show, in [kg], for the torques."""
    payload_com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Its centre of mass from the tool centre point, in the hand's axes, in [m]."""

    @property
    def payload(self) -> Payload | None:
        """The payload, or None without mass.

        Raises:
            ConfigError: A number that is no mass or no place.
        """
        return payload_from(self.payload_kg, self.payload_com)


@dataclass(frozen=True)
class ValidateOptions(HandlingOptions, RetimeOptions, CellOptions):
    """What to validate, and how."""

    file: Path
    """Motion file: .npz, .csv or .mcap."""
    scene: Path | None = field(default=None, kw_only=True)
    """Where things stand instead: a scene file (YAML), objects.json of `replan perceive`, or the folder of a run."""
    look: int = field(default=-1, kw_only=True)
    """Which look of the scene's file or folder, counted from 0; -1 is the last."""
    topic: str | None = field(default=None, kw_only=True)
    """Topic of a recording that has several."""
    index: int | None = field(default=None, kw_only=True)
    """Which message of that topic, counted from 0."""
    start: Joints | None = field(default=None, kw_only=True)
    """Joints where the robot stands, in [rad]; default: the motion's first sample."""
    perturbed: int = field(default=32, kw_only=True)
    """Twins with other poses, masses and friction in which it is tried as well."""
    threads: int = field(default=2, kw_only=True)
    """Threads for simulation; the verdict does not depend on it."""
    seed: int = field(default=0, kw_only=True)
    """Seed of the perturbed twins."""


def reward_text(given: str | None) -> str | None:
    """The reward program that was given, as text or as a file.

    Raises:
        ConfigError: The file cannot be read.
    """
    if given is None or "(" in given:
        return given
    try:
        return Path(given).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"--reward '{given}' is neither reward calls nor a file that can be read ({error})") from None


def payload_from(mass: float, com: tuple[float, float, float]) -> Payload | None:
    """A payload in [kg] and [m], or None without mass.

    Raises:
        ConfigError: A number that is no mass or no place.
    """
    from control.robot.dynamics import Payload

    if not (0.0 <= mass <= HEAVIEST and all(isfinite(c) for c in com)):
        raise ConfigError(f"--payload-kg {mass:g} at {com} is not valid; it is 0 to {HEAVIEST:g} kg at a place in [m]")
    return Payload(mass, com) if mass > 0 else None


def start_from(joints: tuple[float, ...] | None) -> np.ndarray | None:
    """Joints in [rad], shape (7,), or None.

    Raises:
        ConfigError: One is not finite, or looks like degrees.
    """
    if joints is None:
        return None
    import numpy as np

    if not all(isfinite(j) and abs(j) <= 2 * pi for j in joints):
        raise ConfigError(f"--start {joints} is not valid; it is seven joint positions in [rad]")
    return np.array(joints)
