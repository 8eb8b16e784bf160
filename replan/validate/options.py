"""What a validation can be asked for, and how what a person typed becomes it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from control.errors import ConfigError
from control.robot.dynamics import Payload
from sim_check.verdict.verdict import SUCCESS_SHARE

HEAVIEST = 50.0  # [kg]; far beyond what any arm here carries: a larger number is a mistake


@dataclass(frozen=True)
class ValidateOptions:
    """What to validate, and how.

    Attributes:
        file: Motion file.
        cell: Built-in cell or cell file.
        cell_options: Switches of the cell to turn on.
        scene, frame: Where things stand, see `replan.validate.scene_source.scene_for`.
        topic, index: Which message of a recording.
        retime: Whether to put a new time law on the path first.
        fraction: Share of the published speed and acceleration limits for it; the cell's shares if None.
        tolerance: Largest deviation of a joint from the path in [rad] when it is retimed.
        handles: Objects that the hand grasps, in the order in which it does.
        touches: Objects and joints beside them that may be touched and moved: what something is put down on, say.
        held: Object in the hand from the start.
        gripper_width: Distance between the pads at the start in [m]; from the file, or open, if None.
        reward: Text of a reward program, or None.
        payload: What the hand carries that the scene does not show, or None.
        start: Joints where the robot stands in [rad], shape (7,); the first sample if None.
        perturbed: Number of perturbed twins.
        success_share: Least share of them that must succeed.
        threads: For simulation.
        seed: Of the perturbed twins.
    """

    file: Path
    cell: str
    cell_options: tuple[str, ...] = ()
    scene: Path | None = None
    frame: int = -1
    topic: str | None = None
    index: int | None = None
    retime: bool = False
    fraction: float | None = None
    tolerance: float = 0.004
    handles: tuple[str, ...] = ()
    touches: tuple[str, ...] = ()
    held: str | None = None
    gripper_width: float | None = None
    reward: str | None = None
    payload: Payload | None = None
    start: np.ndarray | None = None
    perturbed: int = 32
    success_share: float = SUCCESS_SHARE
    threads: int = 2
    seed: int = 0


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
    if not (np.isfinite(mass) and 0.0 <= mass <= HEAVIEST and np.all(np.isfinite(com))):
        raise ConfigError(f"--payload-kg {mass:g} at {com} is not valid; it is 0 to {HEAVIEST:g} kg at a place in [m]")
    return Payload(mass, com) if mass > 0 else None


def start_from(joints: tuple[float, ...] | None) -> np.ndarray | None:
    """Joints in [rad], shape (7,), or None.

    Raises:
        ConfigError: One is not finite, or looks like degrees.
    """
    if joints is None:
        return None
    if not np.all(np.isfinite(joints)) or max(abs(j) for j in joints) > 2 * np.pi:
        raise ConfigError(f"--start {joints} is not valid; it is seven joint positions in [rad]")
    return np.array(joints)
