"""One run: everything between a typed goal and a judged result. Could be called from a notebook as well."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from control.errors import ConfigError, GoalError, MachineError
from perception.options import PerceptionOptions
from planning.baselines import METHODS
from planning.loop.results import LoopSettings, Part
from planning.reasoners.choice import ReasonerOptions
from replan.errors import DONE, NOT_REACHED
from replan_base.interruption import held_back
from replan_base.processes import python_module

if TYPE_CHECKING:
    from hw_interface.cell.client import CellClient
    from hw_interface.link.security import LinkSecurity
    from planning.loop.results import StepRecord
    from replan.run.stopwatch import Part as PartOfTime

FREE_PORT = "tcp/127.0.0.1:0"  # the process picks one and says which


@dataclass(frozen=True)
class RunOptions:
    """What a run is asked for; the fields are explained by `replan run --help`."""

    goal: str
    cell: str = "cubes"
    cell_options: tuple[str, ...] = ()
    robot: str | None = None
    link: Path | None = None
    seed: int = 0
    speed: float = 1.0
    motion_speed: float | None = None
    detector: str = "default"
    segmenter: str = "default"
    perception: PerceptionOptions = field(default_factory=PerceptionOptions)
    reasoner: ReasonerOptions = field(default_factory=ReasonerOptions)
    runs_dir: Path = Path("runs")
    video: bool = True
    mcap: bool = False
    strip: bool = True
    acknowledge: bool = False
    score: bool = False  # a started simulated cell also answers scorers (benchmarks only)
    without: tuple[str, ...] = ()  # parts of the method that are left out: verifier, perceiver, replan
    method: str = "replan"  # how a goal becomes motions: the method itself, or a baseline that it is compared with
    told: tuple[str, ...] = ()  # facts for a method that plans with symbols
    poses: Literal["seen", "true"] = "seen"  # "true": of what is in view, from a cell that is scored (benchmarks only)


@dataclass(frozen=True)
class RunReport:
    """How a run ended.

    Attributes:
        reached: Whether the goal was reached, as judged on a fresh camera frame.
        reason: One sentence for people.
        seconds: Wall time from the goal to the end in [s], without starting a simulated cell.
        steps: Simulated steps spent in the twin.
        motions: Trajectories sent to the robot.
        replans: How often a subtask or the plan was made anew.
        actions: Every step that was tried, in order.
        seconds_by_part: Wall time in [s] by `replan.run.stopwatch.PARTS`; they add up to `seconds`.
        reasoner, detector: Which backends answered and saw, plainly named.
        questions: Answers asked for, repeated ones included.
        tokens: Of language models, asked and answered; 0 for rules.
        cost: Of these tokens, in the currency of the prices that were given; 0 without prices.
        folder: The run's folder.
        exit_code: Of the command.
    """

    reached: bool
    reason: str
    seconds: float
    steps: int
    motions: int
    replans: int
    actions: tuple["StepRecord", ...]
    seconds_by_part: dict["PartOfTime", float]
    reasoner: str
    detector: str
    questions: int
    tokens: int
    cost: float
    folder: Path
    exit_code: int

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        plain = {f.name: getattr(self, f.name) for f in fields(self)}
        actions = [
            {"action": a.action, "kind": a.kind, "ok": a.ok, "cause": a.cause and a.cause.kind} for a in self.actions
        ]
        parts = {part: round(seconds, 3) for part, seconds in self.seconds_by_part.items()}
        return plain | {
            "folder": str(self.folder),
            "seconds": round(self.seconds, 2),
            "actions": actions,
            "seconds_by_part": parts,
        }

    def as_text(self) -> str:
        """For people."""
        word = "reached" if self.reached else "NOT reached"
        asked = f"{self.questions} questions" + (f", {self.tokens} tokens" if self.tokens else "")
        asked += f", cost {self.cost:.4g}" if self.cost else ""
        return (
            f"goal {word}: {self.reason}\n"
            f"  {self.motions} motions, {self.replans} replans, {self.seconds:.1f} s, {self.steps} simulated steps\n"
            f"  reasoner: {self.reasoner} ({asked}); perception: {self.detector}\n"
            f"  record: {self.folder}"
        )


def run_goal(options: RunOptions, say: Callable[[str], None], on_client: Callable | None = None) -> RunReport:
    """Reach a goal.

    Args:
        options: What to do, with which parts.
        say: Progress for people, one line a call.
        on_client: Called with the connected `CellClient` before and after the run ("before" or "after", client);
            for scorers only.

    Returns:
        The report; the run's folder is complete when this returns or raises.

    Raises:
        GoalError, ConfigError: The goal or the configuration cannot be used; nothing moved.
        ReasonerError: The language backend is not there, or gave no usable plan.
        RobotGoneError: The robot's process died or froze.
        KeyboardInterrupt: After the arm has come to rest.
    """
    if not options.goal.strip():
        raise GoalError('the goal is empty; say what to reach, for instance "place the red cube on the crate"')
    if options.motion_speed is not None and not 0.0 < options.motion_speed <= 1.0:
        raise ConfigError(
            f"--motion-speed {options.motion_speed:g} is not valid; it must be above 0 and at most 1 (the speed that "
            "motions are judged at)"
        )
    check_variant(options)
    from hw_interface.link.security import link_of
    from replan.rendering import require_mujoco
    from sim_check.cells.loading import load_cell

    # The run plans without the part of a cell file that tells a simulated cell what is really there.
    cell = load_cell(options.cell, dict.fromkeys(options.cell_options, True)).model_copy(update={"simulation": None})
    security = link_of(options.robot, options.link)
    with ExitStack() as stack:
        # A simulated cell builds its world while this process imports what it needs: both take seconds.
        endpoint = _endpoint(options, say, stack)
        require_mujoco()
        return _run(options, cell, endpoint, security, say, on_client)


def check_variant(options: RunOptions) -> None:
    """Refuse variants of the method that this program does not have.

    Raises:
        ConfigError: One that is asked for.
    """
    unknown = [part for part in options.without if part not in get_args(Part)]
    if unknown:
        raise ConfigError(f"the method has no part '{unknown[0]}' to leave out; there are: {', '.join(get_args(Part))}")
    if options.without and options.method != "replan":
        raise ConfigError(f"only the method 'replan' has parts to leave out; '{options.method}' has none")
    if options.method not in METHODS:
        raise ConfigError(f"there is no method '{options.method}'; there are: {', '.join(METHODS)}")
    if options.told and not METHODS[options.method].symbolic:
        able = ", ".join(name for name, method in METHODS.items() if method.symbolic)
        raise ConfigError(f"the method '{options.method}' cannot be told facts (--told); these can: {able}")
    if options.poses not in ("seen", "true"):
        raise ConfigError(f"poses '{options.poses}' are not known; there are: seen, true")
    if options.poses == "true" and not options.score:
        raise ConfigError("true poses come from a simulated cell that is scored; only benchmarks start one")


def _run(options, cell, endpoint: Callable[[], str], security: "LinkSecurity | None", say, on_client) -> RunReport:
    # Imported now, while a simulated cell starts: the first retiming would wait a second for it.
    import toppra  # noqa: F401  # pyright: ignore[reportUnusedImport]

    from hw_interface.cell.client import CellClient
    from perception.pipeline import perception_from_options
    from planning.language.furnishings import known_furniture
    from planning.loop.context import RunContext
    from planning.reasoners.choice import make_reasoners, reasoner_names
    from planning.reasoners.usage import UsageLog
    from replan.run.episode import Episode
    from replan.run.film import Film
    from replan.run.motion_executor import TwinCheckedExecutor
    from replan.run.scene_observer import CameraSceneObserver
    from replan.run.stopwatch import Stopwatch
    from replan.run.term_evaluator import SeenTermEvaluator
    from replan.run.true_poses import TruePoses
    from sim_check.furniture.known_models import known_models
    from sim_check.models.known_forms import known_forms

    perception = perception_from_options(
        options.detector, options.segmenter, options.perception, known_models(cell.furniture), known_forms()
    )
    episode = Episode.create(options.runs_dir, options.goal)
    film = Film()
    with ExitStack() as stack:
        stack.callback(episode.close)
        stack.callback(_write_film, film, episode, options, say)
        limits = cell.robot.limits()
        episode.log("run", options=options, cell=cell, limits=limits)
        counting = UsageLog(episode.log)
        try:
            reasoner, by_role = make_reasoners(options.reasoner, options.seed, episode.log, stack, say)
            answered_by = reasoner_names(reasoner, by_role)
            episode.log("parts", reasoner=answered_by, perception=perception.name)
            client: CellClient = stack.enter_context(CellClient.connect(endpoint(), security=security))
            if options.mcap:
                say = _recorded(episode, client, cell, security, say, stack)
            _check_ready(client, options, cell.name, limits.profile, limits.firmware)
            _check_cameras(client, [c.name for c in cell.cameras])
            if options.motion_speed is not None:
                client.set_speed(options.motion_speed)
            if on_client:
                on_client("before", client)
            if options.poses == "true":
                perception = TruePoses(client, tuple(cell.furniture))
            watch = Stopwatch()
            executor = TwinCheckedExecutor(client, cell, limits, options.seed, episode, film, options.video, say, watch)
            observer = CameraSceneObserver(client, perception, episode, film, say, watch)
            started = time.monotonic()
            method = METHODS[options.method]
            context = RunContext(
                goal=options.goal,
                reasoner=reasoner,
                observer=observer,
                executor=executor,
                evaluator=SeenTermEvaluator(executor.palm_position, executor.rest_palm_position, cell.furniture),
                furniture=known_furniture(cell.furniture),
                known_names=cell.objects,
                log=counting,
                say=say,
                pictures=lambda: observer.pictures,
                by_role=by_role,
                told=options.told,
                keep=episode.keep,
                settings=LoopSettings(without=frozenset(options.without)),
            )
            result = method.run(context)
            seconds, by_part = time.monotonic() - started, watch.seconds
            if on_client:
                on_client("after", client)
        except BaseException as error:
            episode.log("reasoner_usage", by_contract=counting.as_rows(), total=counting.total())
            episode.log("ended_early", error=type(error).__name__, reason=str(error))
            raise
        taken = counting.total()
        episode.log("reasoner_usage", by_contract=counting.as_rows(), total=taken)
        report = RunReport(
            reached=result.reached,
            reason=result.reason,
            seconds=seconds,
            steps=executor.steps,
            motions=executor.trajectories_sent,
            replans=result.replans,
            actions=result.steps,
            seconds_by_part=by_part,
            reasoner=answered_by,
            detector=perception.name,
            questions=taken.questions,
            tokens=taken.tokens_in + taken.tokens_out,
            cost=taken.cost,
            folder=episode.folder,
            exit_code=DONE if result.reached else NOT_REACHED,
        )
        episode.log("result", report=report)
    return report


def _recorded(
    episode, client: "CellClient", cell, security: "LinkSecurity | None", say: Callable[[str], None], stack: ExitStack
) -> Callable[[str], None]:
    """Record the run from here on, until `stack` ends; `say` with each line recorded as well."""
    from replan.run.mcap_recording import FILE_NAME, RunRecording

    recording = RunRecording(episode.folder / FILE_NAME, client.endpoint, cell, security, say)
    stack.callback(recording.close)
    episode.on_event, client.on_frame = recording.event, recording.frame
    return recording.telling(say)


def _check_ready(client: "CellClient", options: RunOptions, cell_name: str, profile: str, firmware: str) -> None:
    """Refuse to plan for a robot that stands elsewhere, is another one or was not released by a person."""
    state = client.state()
    if state.cell != cell_name:
        raise ConfigError(
            f"the robot's process serves cell '{state.cell}', but this run plans for '{cell_name}'; "
            f"say --cell {state.cell}"
        )
    if state.profile != profile:
        raise ConfigError(
            f"the robot's profile is '{state.profile}', but the cell file makes it '{profile}'; use the same cell file "
            "(robot and gripper) on both sides"
        )
    if state.firmware != firmware:
        raise ConfigError(
            f"the robot runs firmware '{state.firmware}', but the cell file's profile is for '{firmware}'; use the "
            "profile of this robot's firmware"
        )
    if state.mode in ("stopped", "reflex"):
        if not options.acknowledge:
            why = state.last_error.reason if state.last_error else "stopped on request"
            raise ConfigError(f"the robot is '{state.mode}' ({why}); look at the cell, then say --acknowledge")
        client.acknowledge()


def _check_cameras(client: "CellClient", wanted: list[str]) -> None:
    """Refuse to begin without a camera that the cell file has: what it would have seen might be in the way.

    Raises:
        MachineError: Nobody offers it.
    """
    there = client.cameras()
    missing = [name for name in wanted if name not in there]
    if missing:
        raise MachineError(
            f"nobody offers camera '{missing[0]}' of the cell file; there are {', '.join(there) or 'none'}: start "
            f"its process (replan camera realsense --name {missing[0]} --cell FILE, or zed), or take it out of the "
            "cell file"
        )


def _endpoint(options: RunOptions, say: Callable[[str], None], stack: ExitStack) -> Callable[[], str]:
    """Where the robot is; calling the answer waits until a simulated cell that was started here is ready."""
    if options.robot is not None:
        robot = options.robot
        return lambda: robot
    from hw_interface.cell.process import start_sim_process

    say("no robot named: starting a simulated cell (nothing real moves)")
    command = python_module("replan.main", "robot", "sim", "--cell", options.cell, "--endpoint", FREE_PORT)
    command += ["--seed", str(options.seed), "--speed", str(options.speed)]
    for name in options.cell_options:
        command += ["--option", name]
    if options.score:
        command.append("--score")
    starter = stack.enter_context(ThreadPoolExecutor(1))
    starting = starter.submit(start_sim_process, command)
    stack.callback(lambda: starting.exception() or starting.result().close())
    return lambda: starting.result().endpoint


def _write_film(film, episode, options: RunOptions, say: Callable[[str], None]) -> None:
    with held_back():  # a second Ctrl-C must not leave half a file
        if options.strip and film.write_strip(episode.folder / "strip.png"):
            say(f"pictures: {episode.folder / 'strip.png'}")
        if options.video:
            film.write_video(episode.folder / "run.mp4")
