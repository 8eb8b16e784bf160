"""Validating one motion in the twin: read it, judge exactly its samples, say what every check found."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from control.errors import ConfigError, RefusedError, StackError
from control.motion_files.contents import MotionFile
from control.motion_files.reading import read_motion
from control.retiming.retime import RetimingReport
from control.robot.dynamics import RobotModel
from control.robot.limits import RobotLimits
from control.safety.certificate import Verdict
from control.safety.limits import SafetyLimits
from control.tasks.reward_spec import RewardSpec
from control.trajectory.samples import Trajectory
from control.twin_model import TwinModel
from perception.estimates import SceneEstimate
from planning.language.answers import MalformedAnswerError
from planning.language.reward_program import EXECUTE, build_spec, parse_reward_program
from replan.errors import DONE, UNSAFE
from replan.validate.options import ValidateOptions, reward_text, start_from
from replan.validate.samples import judged_samples
from replan.validate.scene_source import scene_for
from sim_check.cells.loading import CellConfig
from sim_check.twin.payloads import held_payloads, loaded_torque
from sim_check.twin.twin import build_twin
from sim_check.verdict.start_collision import start_collision
from sim_check.verdict.verdict import Judgement, judge_in_detail


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
        payload = self.options.payload
        robot = self.robot if payload is None else self.robot.with_payload(payload)
        return loaded_torque(robot, self.trajectory, held_payloads(self.twin))(q, qd, qdd)

    @property
    def exit_code(self) -> int:
        """0 when it passed, else 4."""
        return DONE if self.verdict.passed else UNSAFE


def validate_motion(options: ValidateOptions, say: Callable[[str], None] = lambda text: None) -> Validation:
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
    reward, payload, stands = reward_text(options.reward), options.payload, start_from(options.start)
    cell = options.load()
    limits, safety = cell.robot.limits(), cell.safety_limits()
    motion = read_motion(options.file, topic=options.topic, index=options.index)
    say(f"read {len(motion.q)} rows, {motion.duration:.2f} s: {motion.source}")
    scene = scene_for(cell, options.scene, options.look)
    opening = cell.robot.gripper_model.opening
    width = options.gripper_width
    if width is None:
        width = float(motion.gripper_width[0]) if motion.gripper_width is not None else opening
    if not 0.0 <= width <= opening:
        raise ConfigError(f"the gripper cannot be {width:g} m open at the start; it opens from 0 to {opening:g} m")
    _check_names(options, scene)
    robot = RobotModel.panda(gripper=cell.robot.gripper_model)
    start = motion.q[0] if stands is None else stands
    _refuse_collision(motion, cell, scene, start, width, options)
    try:
        twin = build_twin(cell, scene, start, width, options.held)
    except ConfigError:
        raise
    except StackError as error:
        raise ConfigError(f"no twin of {_scene_name(options)}: {error}") from error
    say(f"twin: {', '.join(scene.names)} ({scene.source})")
    trajectory, retiming, made = judged_samples(motion, options, robot, limits, safety, twin)
    spec = None if reward is None else _spec(reward, scene, twin)
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
        payload=payload,
        on_progress=lambda done, all: say(f"judged in {done} of {all} twins") if done in (1, all) else None,
    )
    return Validation(
        options, cell, limits, safety, motion, trajectory, retiming, made, scene, twin, robot, spec, judgement
    )


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
