"""Validating one motion in the twin: read it, judge exactly its samples, say what every check found."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from control.certificate import Verdict
from control.errors import ConfigError, RefusedError, RetimingError, StackError
from control.limits import RobotLimits
from control.motion_file import read_motion
from control.motion_path import to_path
from control.motion_samples import MotionFile
from control.resampling import to_trajectory_with_report
from control.retime import RetimingReport, retime_with_report
from control.rewards import RewardSpec
from control.robot import Payload, RobotModel
from control.safety import SafetyLimits
from control.segment_timing import RetimingOptions
from control.trajectory import PathSegment, Trajectory, TrajectorySegment
from control.twin_model import TwinModel
from perception.estimates import SceneEstimate
from planning.answers import MalformedAnswerError
from planning.reward_program import EXECUTE, build_spec, parse_reward_program
from replan.errors import DONE, UNSAFE
from replan.scene_source import scene_for
from sim_check.cells import CellConfig, load_cell
from sim_check.foreign_motion import path_with_handling, with_handling
from sim_check.payloads import held_payloads, loaded_torque
from sim_check.start_collision import start_collision
from sim_check.twin import build_twin
from sim_check.verdict import SUCCESS_SHARE, Judgement, judge_in_detail

HEAVIEST = 50.0  # [kg]; far beyond what any arm here carries: a larger number is a mistake
TOLD_DEPARTURE = 1e-3  # [rad] that a curve leaves the lines between rows by before it is worth a word
GRASP_FORCE = 40.0  # [N]; Franka's usual grasp force, for closings of which a file gives none


@dataclass(frozen=True)
class ValidateOptions:
    """What to validate, and how.

    Attributes:
        file: Motion file.
        cell: Built-in cell or cell file.
        cell_options: Switches of the cell to turn on.
        scene, frame: Where things stand, see `replan.scene_source.scene_for`.
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


@dataclass(frozen=True)
class Validation:
    """What became of it; everything that a report needs.

    Attributes:
        options: What was asked for.
        cell, limits, safety: What it was held against.
        motion: The file as read.
        trajectory: What was judged: its samples, or the retimed ones.
        retiming: How it was retimed, or None.
        made: How its samples came about, in words.
        scene, twin: What it was judged in.
        robot: Rigid-body model with an empty hand.
        spec: What it should achieve, or None.
        judgement: Verdict and the nominal twin's motion.
    """

    options: ValidateOptions
    cell: CellConfig
    limits: RobotLimits
    safety: SafetyLimits
    motion: MotionFile
    trajectory: Trajectory
    retiming: RetimingReport | None
    made: str
    scene: SceneEstimate
    twin: TwinModel
    robot: RobotModel
    spec: RewardSpec | None
    judgement: Judgement

    @property
    def verdict(self) -> Verdict:
        """The verdict."""
        return self.judgement.verdict

    def torque(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Torques in [Nm] as they were judged, for the samples with three rows of rest on either side."""
        robot = self.robot if self.options.payload is None else self.robot.with_payload(self.options.payload)
        return loaded_torque(robot, self.trajectory, held_payloads(self.twin))(q, qd, qdd)

    @property
    def exit_code(self) -> int:
        """0 when it passed, else 4."""
        return DONE if self.verdict.passed else UNSAFE


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


def validate_motion(options: ValidateOptions, say: Callable[[str], None]) -> Validation:
    """Judge the motion in a file.

    Raises:
        MotionFileError: The file cannot be used; names file and row.
        ConfigError: Cell, scene or an option is not valid.
        RefusedError: start_in_collision, or cannot_be_retimed: there is nothing to judge.
    """
    if options.perturbed < 0 or options.threads < 1:
        raise ConfigError(
            f"{options.perturbed} perturbed twins on {options.threads} threads is not valid; "
            "give --perturbed 0 or more and --threads 1 or more"
        )
    cell = load_cell(options.cell, dict.fromkeys(options.cell_options, True))
    limits, safety = cell.robot.limits(), cell.safety_limits()
    motion = read_motion(options.file, topic=options.topic, index=options.index)
    say(f"read {len(motion.q)} rows, {motion.duration:.2f} s: {motion.source}")
    scene = scene_for(cell, options.scene, options.frame)
    opening = cell.robot.gripper_model.opening
    width = options.gripper_width
    if width is None:
        width = float(motion.gripper_width[0]) if motion.gripper_width is not None else opening
    if not 0.0 <= width <= opening:
        raise ConfigError(f"the gripper cannot be {width:g} m open at the start; it opens from 0 to {opening:g} m")
    _check_names(options, scene)
    robot = RobotModel.panda(gripper=cell.robot.gripper_model)
    start = motion.q[0] if options.start is None else options.start
    _refuse_collision(motion, cell, scene, start, width, options)
    try:
        twin = build_twin(cell, scene, start, width, options.held)
    except ConfigError:
        raise
    except StackError as error:
        raise ConfigError(f"no twin of {_scene_name(options)}: {error}") from error
    say(f"twin: {', '.join(scene.names)} ({scene.source})")
    trajectory, retiming, made = _samples(motion, options, robot, limits, safety, twin)
    spec = None if options.reward is None else _spec(options.reward, scene, twin)
    judgement = judge_in_detail(
        trajectory,
        twin,
        safety,
        limits,
        np.random.default_rng(options.seed),
        spec=spec,
        handled=_handled(options, trajectory, twin),
        perturbed=options.perturbed,
        nthread=options.threads,
        robot=robot,
        success_share=options.success_share,
        payload=options.payload,
        on_progress=lambda done, all: say(f"judged in {done} of {all} twins") if done in (1, all) else None,
    )
    return Validation(
        options, cell, limits, safety, motion, trajectory, retiming, made, scene, twin, robot, spec, judgement
    )


def _samples(
    motion: MotionFile,
    options: ValidateOptions,
    robot: RobotModel,
    limits: RobotLimits,
    safety: SafetyLimits,
    twin: TwinModel,
) -> tuple[Trajectory, RetimingReport | None, str]:
    """What is judged: the file's samples, or its path with a new time law; and how it was made of the file."""
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
    loaded = robot if options.payload is None else robot.with_payload(options.payload)
    how = RetimingOptions(tolerance=options.tolerance)
    try:
        trajectory, report = retime_with_report(path, loaded, limits, safety, how, held_payloads(twin))
    except RetimingError as error:
        raise RefusedError("cannot_be_retimed", f"{options.file}: the path cannot be timed: {error}") from error
    off = f"at most {1e3 * report.deviation:.1f} mrad off the path"
    return trajectory, report, f"retimed to {report.ratio:.2f} times the time-optimal bound, {off}"


def _says_what_it_handles(segments: Sequence[PathSegment | TrajectorySegment]) -> bool:
    return any(s.held or s.touching for s in segments)


def _scene_name(options: ValidateOptions) -> str:
    return f"the poses of cell {options.cell}" if options.scene is None else str(options.scene)


def _refuse_collision(
    motion: MotionFile,
    cell: CellConfig,
    scene: SceneEstimate,
    start: np.ndarray,
    width: float,
    options: ValidateOptions,
) -> None:
    """Say what the arm is inside of where it starts.

    Things are left where they are said to stand for that; the twin itself is built around the arm.
    """
    try:
        twin = build_twin(cell, scene, start, width, options.held, around_arm=False)
    except StackError:
        return  # told in full where the twin itself is built
    found = start_collision(twin)
    if found is None:
        return
    (own, other), depth = found
    what = "where the robot stands" if options.start is not None else f"{options.file}, {motion.row(0)}"
    raise RefusedError(
        "start_in_collision",
        f"{what}: the motion starts in collision: {own} and {other} overlap by {1e3 * depth:.1f} mm; look at this "
        f"configuration, or at where {_scene_name(options)} puts '{other}'",
    )


def _check_names(options: ValidateOptions, scene: SceneEstimate) -> None:
    for flag, names in (("--handles", options.handles), ("--held", (options.held,) if options.held else ())):
        for name in names:
            if scene.get(name) is None:
                raise ConfigError(f"{flag} names '{name}', which the scene does not have; it has {sorted(scene.names)}")


def _spec(text: str, scene: SceneEstimate, twin: TwinModel) -> RewardSpec:
    """The reward that a program asks for; its last line may be left out."""
    program = text if EXECUTE in text else f"{text}\n{EXECUTE}(2)"
    joints = [j.name for j in twin.joints]
    try:
        read = parse_reward_program(program, scene.names, joints)
    except MalformedAnswerError as error:
        raise ConfigError(f"--reward: {error}") from error
    if read.drops:
        dropped = "; ".join(f"{d.text}: {d.reason}" for d in read.drops)
        raise ConfigError(f"--reward: a term cannot be used: {dropped}")
    primary = [k for k, c in enumerate(read.calls) if c.term.primary]
    if len(primary) != 1:
        raise ConfigError(f"--reward: {len(primary)} terms say primary_reward=True; exactly one must")
    return build_spec(read.calls, primary[0])


def _handled(options: ValidateOptions, trajectory: Trajectory, twin: TwinModel) -> frozenset[str]:
    """What may be touched and moved: what is named, and what the file's own segments name."""
    known = {o.name for o in twin.objects} | {j.name for j in twin.joints}
    for name in options.touches:
        if name not in known:
            raise ConfigError(
                f"--touches names '{name}', which is neither object nor joint here; there are {sorted(known)}"
            )
    named = {*options.handles, *options.touches, *((options.held,) if options.held else ())}
    for s in trajectory.segments:
        named |= {s.held} if s.held else set()
        named |= {name for pair in s.touching for name in pair}
    return frozenset(named & known)
