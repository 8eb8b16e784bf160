"""The samples that a validation judges: those of the file, or its path with a new timing."""

from collections.abc import Sequence
from dataclasses import replace

from control.errors import ConfigError, RefusedError, RetimingError
from control.motion_files.contents import MotionFile
from control.motion_files.paths import to_path
from control.motion_files.resampling import to_trajectory_with_report
from control.retiming.retime import RetimingReport, retime_with_report
from control.retiming.segment_timing import RetimingOptions
from control.robot.dynamics import RobotModel
from control.robot.limits import RobotLimits
from control.safety.limits import SafetyLimits
from control.trajectory.samples import PathSegment, Trajectory, TrajectorySegment
from control.twin_model import TwinModel
from replan.validate.options import ValidateOptions
from sim_check.twin.external_motion import path_with_handling, with_handling
from sim_check.twin.payloads import held_payloads

TOLD_DEPARTURE = 1e-3  # [rad] that a curve leaves the lines between rows by before it is worth a word
GRASP_FORCE = 40.0  # [N]; Franka's usual grasp force, for closings of which a file gives none


def judged_samples(
    motion: MotionFile,
    options: ValidateOptions,
    robot: RobotModel,
    limits: RobotLimits,
    safety: SafetyLimits,
    twin: TwinModel,
) -> tuple[Trajectory, RetimingReport | None, str]:
    """What is judged, how it was retimed, and in words how it was made of the file.

    Args:
        motion: The file.
        options: Whether to retime, and what is handled.
        robot, limits, safety: What retiming keeps to.
        twin: For what the objects weigh.

    Raises:
        ConfigError: A share without retiming, or one that is none; an object that is never grasped.
        RefusedError: cannot_be_retimed, with the place and the limit that makes it so.
    """
    force = GRASP_FORCE if options.handles else None
    if not options.retime:
        if options.fraction is not None:
            raise ConfigError("--fraction says how fast a motion is retimed; give --retime as well")
        trajectory, report = to_trajectory_with_report(motion, force)
        made = report.method
        if report.departure > TOLD_DEPARTURE:
            made += (
                f"; between rows it leaves the straight line by up to {report.departure:.3f} rad "
                f"({trajectory.joint_names[report.joint]} at {report.at:.2f} s)"
            )
        if not _says_what_it_handles(trajectory.segments):
            trajectory = with_handling(trajectory, options.handles, options.held)
        return trajectory, None, made
    if options.fraction is not None:
        if not 0.0 < options.fraction <= 1.0:
            raise ConfigError(f"--fraction {options.fraction:g} is not valid; it is a share of the limits, 0 to 1")
        safety = replace(
            safety,
            velocity_scale=min(options.fraction, safety.velocity_scale),
            acceleration_scale=min(options.fraction, safety.acceleration_scale),
        )
    path = to_path(motion, force)
    if not _says_what_it_handles(path.segments):
        path = path_with_handling(path, options.handles, options.held)
    payload = options.payload
    loaded = robot if payload is None else robot.with_payload(payload)
    how = RetimingOptions(tolerance=1e-3 * options.tolerance_mrad)
    try:
        trajectory, report = retime_with_report(path, loaded, limits, safety, how, held_payloads(twin))
    except RetimingError as error:
        raise RefusedError("cannot_be_retimed", f"{options.file}: the path cannot be timed: {error}") from error
    off = f"at most {1e3 * report.deviation:.1f} mrad off the path"
    return trajectory, report, f"retimed to {report.ratio:.2f} times the time-optimal bound, {off}"


def _says_what_it_handles(segments: Sequence[PathSegment | TrajectorySegment]) -> bool:
    return any(s.held or s.touching for s in segments)
