"""`replan validate FILE`: a motion judged in the twin before any robot plays it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from replan.commands.flags import SetOnly, Switches, options_in
from replan.options import CellOptions
from replan.validate.options import ValidateOptions

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True, kw_only=True)
class Validate(ValidateOptions):
    """Judge a motion in the twin: every safety check, nominal and in perturbed twins, with a report to look at.

    Reads this program's own trajectories (.npz), CSV, NPZ and ROS 2 recordings (.mcap) of JointTrajectory; the formats
    stand in docs/motion-files.md. Nothing moves. Exit code 0 when the motion passed, 4 when it is refused, 2 when the
    file, the scene or an option cannot be used.
    """

    file: tyro.conf.Positional[Path]
    cell: str = CellOptions.cell
    """Built-in cell or a cell file (YAML): robot, gripper, limits, and where things stand (`poses`)."""
    cell_options: Switches = CellOptions.cell_options
    retime: SetOnly = ValidateOptions.retime
    save: Path | None = None
    """Write the samples that were judged as a trajectory file (.npz), for instance those of --retime."""
    certificate: Path | None = None
    """When it passes, write the right to play exactly these samples once (`replan robot play`) as JSON."""
    valid_for: float = 120.0
    """How long that certificate is good for, in [s]; a robot also refuses scenes that are too old."""
    out: Path = Path("validated")
    """Folder for the report, NAME.html."""
    report: bool = True
    """Write the report: checks, plots against limits, clearances, pictures of the worst moments."""
    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run it; returns the exit code."""
        console.note(f"reading {self.file}")
        import time

        begun = time.monotonic()
        from replan.rendering import require_mujoco

        require_mujoco()
        from control.motion_files.trajectory_file import write_trajectory
        from control.safety.certificate_file import write_certificate
        from replan.validate.certificate import certificate_of, check_outputs
        from replan.validate.motion import validate_motion
        from replan.validate.report import footer, write_report
        from replan.validate.text import as_json, as_text

        options = options_in(self, ValidateOptions)
        check_outputs(self.certificate, self.save, self.perturbed)
        validation = validate_motion(options, console.note)
        seconds = time.monotonic() - begun
        files: dict[str, str] = {}
        if self.save is not None:
            write_trajectory(self.save, validation.trajectory)
            files["trajectory"] = str(self.save)
        if self.certificate is not None and validation.verdict.passed:
            write_certificate(self.certificate, certificate_of(validation, self.valid_for))
            files["certificate"] = str(self.certificate)
        if self.report:
            path = self.out / f"{self.file.stem}.html"
            console.note("drawing the report")
            write_report(validation, path, footer())
            files["report"] = str(path)
        console.result(as_json(validation, files, seconds), as_text(validation, files))
        return validation.exit_code
