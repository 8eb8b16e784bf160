"""`replan validate FILE`: a motion judged in the twin before any robot plays it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True)
class Validate:
    """Judge a motion in the twin: every safety check, nominal and in perturbed twins, with a report to look at.

    Reads this program's own trajectories (.npz), CSV, NPZ and ROS 2 recordings (.mcap) of JointTrajectory; the formats
    stand in docs/motion-files.md. Nothing moves. Exit code 0 when the motion passed, 4 when it is refused, 2 when the
    file, the scene or an option cannot be used.
    """

    file: tyro.conf.Positional[Path]
    """Motion file: .npz, .csv or .mcap."""
    cell: str = "cubes"
    """Built-in cell or a cell file (YAML): robot, gripper, limits, and where things stand (`poses`)."""
    option: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Switch of the cell to turn on; may be repeated."""
    scene: Path | None = None
    """Where things stand instead: a scene file (YAML), objects.json of `replan perceive`, or the folder of a run."""
    look: int = -1
    """Which look of the scene's file or folder, counted from 0; -1 is the last."""
    topic: str | None = None
    """Topic of a recording that has several."""
    index: int | None = None
    """Which message of that topic, counted from 0."""
    retime: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Put a new time law on the path first, and judge that."""
    fraction: float | None = None
    """With --retime: share of the published speeds and accelerations to use; default: what the cell allows."""
    tolerance_mrad: float = 4.0
    """With --retime: how far a joint may leave the path, in [mrad]."""
    save: Path | None = None
    """Write the samples that were judged as a trajectory file (.npz), for instance those of --retime."""
    certificate: Path | None = None
    """When it passes, write the right to play exactly these samples once (`replan robot play`) as JSON."""
    valid_for: float = 120.0
    """How long that certificate is good for, in [s]; a robot also refuses scenes that are too old."""
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
    start: tuple[float, float, float, float, float, float, float] | None = None
    """Joints where the robot stands, in [rad]; default: the motion's first sample."""
    perturbed: int = 32
    """Twins with other poses, masses and friction in which it is tried as well."""
    threads: int = 2
    """Threads for simulation; the verdict does not depend on it."""
    seed: int = 0
    """Seed of the perturbed twins."""
    out: Path = Path("validated")
    """Folder for the report, NAME.html."""
    report: bool = True
    """Write the report: checks, plots against limits, clearances, pictures of the worst moments."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
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
        from replan.validate.options import ValidateOptions, payload_from, reward_text, start_from
        from replan.validate.report import footer, write_report
        from replan.validate.text import as_json, as_text

        options = ValidateOptions(
            file=self.file,
            cell=self.cell,
            cell_options=tuple(self.option),
            scene=self.scene,
            frame=self.look,
            topic=self.topic,
            index=self.index,
            retime=self.retime,
            fraction=self.fraction,
            tolerance=1e-3 * self.tolerance_mrad,
            handles=self.handles,
            touches=self.touches,
            held=self.held,
            gripper_width=self.gripper_width,
            reward=reward_text(self.reward),
            payload=payload_from(self.payload_kg, self.payload_com),
            start=start_from(self.start),
            perturbed=self.perturbed,
            threads=self.threads,
            seed=self.seed,
        )
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
