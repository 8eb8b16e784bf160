"""One run: everything between a typed goal and a judged result. Could be called from a notebook as well."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING

from control.errors import ConfigError, GoalError
from planning.baselines import METHODS
from replan.errors import DONE, NOT_REACHED
from replan.run.cell_start import endpoint_of
from replan.run.method_choice import check_variant, settings_of
from replan.run.options import RunOptions
from replan.run.report import RunReport

if TYPE_CHECKING:
    from hw_interface.cell.client import CellClient
    from hw_interface.link.security import LinkSecurity
    from sim_check.cells.loading import CellConfig

    OnClient = Callable[[str, CellClient], object]


def run_goal(
    options: RunOptions, say: Callable[[str], None] = lambda text: None, on_client: "OnClient | None" = None
) -> RunReport:
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

    # The run plans without the part of a cell file that tells a simulated cell what is really there.
    cell = options.load().model_copy(update={"simulation": None})
    security = link_of(options.robot, options.link)
    with ExitStack() as stack:
        # A simulated cell builds its world while this process imports what it needs: both take seconds.
        endpoint = endpoint_of(options, say, stack)
        require_mujoco()
        return _run(options, cell, endpoint, security, say, on_client)


def _run(
    options: RunOptions,
    cell: "CellConfig",
    endpoint: Callable[[], str],
    security: "LinkSecurity | None",
    say: Callable[[str], None],
    on_client: "OnClient | None",
) -> RunReport:
    # Imported now, while a simulated cell starts: the first retiming would wait a second for it.
    import toppra  # noqa: F401  # pyright: ignore[reportUnusedImport]

    from hw_interface.cell.client import CellClient
    from perception.pipeline import perception_from_options
    from planning.language.furnishings import known_furniture
    from planning.loop.context import RunContext
    from planning.reasoners.choice import make_reasoners, reasoner_names
    from planning.reasoners.usage import UsageLog
    from replan.run.motion_executor import TwinCheckedExecutor
    from replan.run.readiness import check_cameras, check_ready, check_simulated
    from replan.run.recording import begin_record, record_mcap, usage_recorded
    from replan.run.scene_observer import CameraSceneObserver
    from replan.run.session import RunSession
    from replan.run.stopwatch import Stopwatch
    from replan.run.term_evaluator import SeenTermEvaluator
    from replan.run.true_poses import TruePoses
    from sim_check.furniture.known_models import known_models
    from sim_check.models.known_forms import known_forms

    furniture = known_models(cell.furniture)
    perception = perception_from_options(
        options.detector, options.segmenter, options.perception, furniture, known_forms()
    )
    with ExitStack() as stack:
        episode, film = begin_record(options, options.goal, say, stack)
        limits = cell.robot.limits()
        episode.log("run", options=options, cell=cell, limits=limits)
        usage = UsageLog(episode.log)
        with usage_recorded(episode, usage):
            reasoner, by_role = make_reasoners(options.reasoner, options.seed, episode.log, stack, say)
            answered_by = reasoner_names(reasoner, by_role)
            episode.log("parts", reasoner=answered_by, perception=perception.name)
            client = stack.enter_context(CellClient.connect(endpoint(), security=security))
            if options.mcap:
                say = record_mcap(episode, client, cell, security, say, stack)
            check_ready(client, cell.name, limits.profile, limits.firmware, options.acknowledge)
            if options.go_on_after_stall:
                check_simulated(client)
            check_cameras(client, [c.name for c in cell.cameras])
            if options.motion_speed is not None:
                client.set_speed(options.motion_speed)
            if on_client:
                on_client("before", client)
            if options.poses == "true":
                perception = TruePoses(client, tuple(cell.furniture))
            session = RunSession(client, cell, limits, episode, film, say, Stopwatch())
            observer = CameraSceneObserver(session, perception, None if options.poses == "true" else furniture)
            executor = TwinCheckedExecutor(
                session, options.seed, options.video, options.go_on_after_stall, observer.look_again
            )
            context = RunContext(
                goal=options.goal,
                reasoner=reasoner,
                by_role=by_role,
                observer=observer,
                executor=executor,
                evaluator=SeenTermEvaluator(executor.palm_position, executor.rest_palm_position, cell.furniture),
                furniture=known_furniture(cell.furniture),
                known_names=cell.objects,
                told=options.told,
                log=usage,
                say=say,
                keep=episode.keep,
                pictures=lambda: observer.pictures,
                settings=settings_of(options),
            )
            started = time.monotonic()
            result = METHODS[options.method].run(context)
            seconds, by_part = time.monotonic() - started, session.watch.seconds
            if on_client:
                on_client("after", client)
        taken = usage.total()
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
