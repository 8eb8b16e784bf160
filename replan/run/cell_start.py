"""Where the robot of a run is: at the endpoint that was named, or in a simulated cell that is started here."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import TYPE_CHECKING

from replan_base.processes import python_module

if TYPE_CHECKING:
    from replan.run.options import RunOptions

FREE_PORT = "tcp/127.0.0.1:0"  # the process picks one and says which


def endpoint_of(options: "RunOptions", say: Callable[[str], None], stack: ExitStack) -> Callable[[], str]:
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
