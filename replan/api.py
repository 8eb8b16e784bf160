"""What the commands do, as functions: reach a goal, judge a motion, perceive a recording, talk to a robot's process.

Options go in as frozen dataclasses, results come back as objects. No function prints, ends the process or draws a bar;
progress goes to a callback, one line a call. Whatever a person can mend is a `ReplanError`; all of them are drawn in
`replan_base/errors.py`, `control/errors.py` and `perception/errors.py`. Texts name options as the command line spells
them. KeyboardInterrupt passes through, after an arm that was set in motion has come to rest.

Importing this module costs some milliseconds: types are imported when they are named first, the rest when a function is
called.

What libraries read from the environment stays theirs: `MUJOCO_GL` chooses the rendering, `HF_HOME` says where weights
are. A key for a language server is read from the variable that `ReasonerOptions.key_variable` names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from replan_base.errors import MissingPartError, ReplanError
from replan_base.packages import require_own_packages
from replan_base.parts import missing_parts_named

if TYPE_CHECKING:
    from control.errors import (
        ConfigError,
        GoalError,
        MachineError,
        MotionFileError,
        ReasonerError,
        RefusedError,
        RobotGoneError,
        StackError,
        StoppedError,
    )
    from control.safety.certificate import Certificate, Verdict
    from control.trajectory.samples import Trajectory
    from hw_interface.cell.client import CellClient
    from perception.errors import PerceptionError
    from perception.options import PerceptionOptions
    from planning.reasoners.options import ReasonerOptions
    from replan.perceive.options import PerceiveOptions, ReadingOptions
    from replan.perceive.report import PerceiveReport
    from replan.run.options import RunOptions
    from replan.run.report import RunReport
    from replan.validate.motion import Validation
    from replan.validate.options import ValidateOptions
    from sim_check.cells.loading import CellConfig

__all__ = [
    "CellClient",
    "CellConfig",
    "Certificate",
    "ConfigError",
    "GoalError",
    "MachineError",
    "MissingPartError",
    "MotionFileError",
    "PerceiveOptions",
    "PerceiveReport",
    "PerceptionError",
    "PerceptionOptions",
    "ReadingOptions",
    "ReasonerError",
    "ReasonerOptions",
    "RefusedError",
    "ReplanError",
    "RobotGoneError",
    "RunOptions",
    "RunReport",
    "StackError",
    "StoppedError",
    "Trajectory",
    "ValidateOptions",
    "Validation",
    "Verdict",
    "certify_motion",
    "connect",
    "load_cell",
    "perceive_recording",
    "run_goal",
    "silent",
    "validate_motion",
    "write_motion",
]

# Where types live; each is imported when it is named first, after the packages were found to be ours.
_MODULES = {
    "CellClient": "hw_interface.cell.client",
    "CellConfig": "sim_check.cells.loading",
    "Certificate": "control.safety.certificate",
    "ConfigError": "control.errors",
    "GoalError": "control.errors",
    "MachineError": "control.errors",
    "MotionFileError": "control.errors",
    "PerceiveOptions": "replan.perceive.options",
    "PerceiveReport": "replan.perceive.report",
    "PerceptionError": "perception.errors",
    "PerceptionOptions": "perception.options",
    "ReadingOptions": "replan.perceive.options",
    "ReasonerError": "control.errors",
    "ReasonerOptions": "planning.reasoners.options",
    "RefusedError": "control.errors",
    "RobotGoneError": "control.errors",
    "RunOptions": "replan.run.options",
    "RunReport": "replan.run.report",
    "StackError": "control.errors",
    "StoppedError": "control.errors",
    "Trajectory": "control.trajectory.samples",
    "ValidateOptions": "replan.validate.options",
    "Validation": "replan.validate.motion",
    "Verdict": "control.safety.certificate",
}
Progress = Callable[[str], object]


def __getattr__(name: str) -> Any:
    """A type that is named for the first time.

    Raises:
        AttributeError: There is nothing of that name.
        MissingPartError: It needs a package that is not installed.
    """
    if name not in _MODULES:
        raise AttributeError(f"replan.api has no '{name}'; it has {', '.join(__all__)}")
    with _usable():
        value = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Everything that is public."""
    return [*__all__, "Progress"]


def silent(line: str) -> None:
    """Tell nobody."""


def run_goal(options: RunOptions, progress: Progress = silent) -> RunReport:
    """Reach a goal with a robot: look, plan, find a motion, judge it in the twin, play it, look again.

    Without `options.robot` a simulated cell is started in a process of its own, and ended afterwards. The run's folder
    is complete when this returns or raises.

    Args:
        options: What to reach, where, with which parts.
        progress: Called with each line of progress.

    Returns:
        Whether the goal was reached, as judged on a fresh look, and what it took.

    Raises:
        GoalError, ConfigError: The goal or an option cannot be used; nothing moved.
        MissingPartError, MachineError: A package, the rendering or a port is not there.
        ReasonerError: The language backend is not there, or gave no usable plan.
        PerceptionError: Weights that were asked for cannot be used, or nothing can be seen.
        RobotGoneError: The robot's process died or froze.
        RefusedError: The robot's process refused a request; nothing moved.
    """
    with _usable():
        from replan.run.goal import run_goal as run

        return run(options, _told(progress))


def validate_motion(options: ValidateOptions, progress: Progress = silent) -> Validation:
    """Judge the motion in a file in the twin and in perturbed twins, against every safety check. Nothing moves.

    Args:
        options: The file, the cell, where things stand, what may be touched.
        progress: Called with each line of progress.

    Returns:
        The verdict with each check's worst value, and the samples that were judged.

    Raises:
        MotionFileError: The file cannot be used; names file and row.
        ConfigError: Cell, scene or an option is not valid.
        RefusedError: The motion starts in collision, or cannot be retimed: there is nothing to judge.
        MissingPartError, MachineError: A package or the rendering is not there.
    """
    with _usable():
        from replan.rendering import require_mujoco
        from replan.validate.motion import validate_motion as validate

        require_mujoco()
        return validate(options, _told(progress))


def certify_motion(validation: Validation, valid_for: float = 120.0) -> Certificate:
    """The right to play exactly the samples that passed, once.

    Poses that a person wrote down count as seen when they were read: whoever asks for the certificate vouches for them.

    Args:
        validation: What passed, in as many perturbed twins as a run tries its own motions in, or more.
        valid_for: Lifetime in [s]; a robot also refuses scenes that are too old.

    Returns:
        What `CellClient.execute` takes beside the trajectory.

    Raises:
        ConfigError: It was tried in too few perturbed twins.
        StackError: It did not pass, or the lifetime is not valid.
    """
    with _usable():
        from control.errors import ConfigError
        from replan.validate.certificate import LEAST_TWINS, certificate_of

        tried = validation.verdict.trials
        if tried < LEAST_TWINS:
            raise ConfigError(f"no certificate from {tried} perturbed twins; let it be tried in {LEAST_TWINS} or more")
        return certificate_of(validation, valid_for)


def write_motion(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory as a file that `validate_motion` and `replan robot play` read (docs/motion-files.md).

    Args:
        path: File to write; ends with .npz.
        trajectory: For instance `Validation.trajectory`.

    Raises:
        StackError: The file cannot be written.
    """
    with _usable():
        from control.motion_files.trajectory_file import write_trajectory

        write_trajectory(path, trajectory)


def perceive_recording(
    recording: Path, options: PerceiveOptions, reading: ReadingOptions | None = None, progress: Progress = silent
) -> PerceiveReport:
    """Find objects and their poses in recorded RGB-D frames, without a robot.

    Writes objects.json, a picture a frame and a page into `options.out`. A frame that cannot be used is skipped and
    named.

    Args:
        recording: Folder of PNG pairs, BOP scene, MCAP or .npz file (docs/perceive.md).
        options: What to look for, with which detector, what to write.
        reading: Which of its frames; None for all.
        progress: Called with each line of progress, every few seconds at most.

    Returns:
        How often each name was found, things as they were known at the end, what was skipped.

    Raises:
        PerceptionError: The recording, or every frame of it, cannot be used; or weights are not on this machine.
        ConfigError: The output folder cannot be written, or an option is not valid.
        MissingPartError: A package is not there.
    """
    with _usable():
        from replan.perceive.recording import perceive_recording as perceive

        return perceive(recording, options, reading, _told(progress), quiet=True)


def connect(endpoint: str, link: Path | None = None, timeout: float = 5.0) -> CellClient:
    """A client of a running robot process: its state, its cameras, stopping, playing certified motions.

    Use it in a `with` statement; leaving it brings a motion that it sent to rest.

    Args:
        endpoint: tcp/HOST:PORT within this machine, tls/HOST:PORT with a link file.
        link: Link file with this machine's certificates (docs/security.md).
        timeout: Longest wait for the connection, and later for each answer, in [s].

    Raises:
        ConfigError: The endpoint or the link file is not valid.
        RobotGoneError: Nobody answers there, or certificates are not accepted.
        StackError: The other side speaks another version of the protocol.
    """
    with _usable():
        from hw_interface.cell.client import CellClient
        from hw_interface.link.security import link_or_none

        return CellClient.connect(endpoint, timeout, link_or_none(link))


def load_cell(name_or_path: str | Path, switches: tuple[str, ...] = ()) -> CellConfig:
    """Read a cell by the name of a built-in one or from a YAML file (docs/cells.md).

    Args:
        name_or_path: A name, or a path with a "/" or ending with .yaml or .yml.
        switches: Of the cell's options, those to turn on.

    Raises:
        ConfigError: There is no such cell or switch, or a key or value is not valid; says which.
    """
    with _usable():
        from sim_check.cells.loading import load_cell as load

        return load(name_or_path, dict.fromkeys(switches, True))


def _told(progress: Progress) -> Callable[[str], None]:
    """The same without an answer."""

    def tell(line: str) -> None:
        progress(line)

    return tell


@contextmanager
def _usable() -> Iterator[None]:
    """Refuse an environment that mixes packages, and name parts that are not installed."""
    require_own_packages()
    with missing_parts_named():
        yield
