"""The eight tasks of the benchmark: goal as a person types it, cell, and what has to be true at the end."""

from collections.abc import Callable
from dataclasses import dataclass

from control.errors import ConfigError
from replan.rc.ending import Ending
from replan.rc.scoring import found, lies_in, opened, rests_on

IN_CABINET = "place the yellow cube in the wooden cabinet"


@dataclass(frozen=True)
class RcTask:
    """One task.

    Attributes:
        name: On the command line and in files.
        title: As in the paper.
        goal: As a person types it.
        cell: Built-in cell.
        needed: Loose things that the task lets a robot move; nothing else may come to harm.
        scorer: Why the goal is not reached; "" where it is.
    """

    name: str
    title: str
    goal: str
    cell: str
    needed: tuple[str, ...]
    scorer: Callable[[Ending], str]


def _yellow_in_cabinet(ending: Ending) -> str:
    return lies_in(ending, "yellow_cube", "wooden_cabinet")


_ALL = (
    RcTask("cabinet-open", "Cabinet-Open", IN_CABINET, "cabinet-open", ("yellow_cube",), _yellow_in_cabinet),
    RcTask("cabinet-closed", "Cabinet-Closed", IN_CABINET, "cabinet-closed", ("yellow_cube",), _yellow_in_cabinet),
    RcTask(
        "cabinet-blocked",
        "Cabinet-Blocked",
        IN_CABINET,
        "cabinet-blocked",
        ("yellow_cube", "red_bar"),
        _yellow_in_cabinet,
    ),
    RcTask(
        "cabinet-locked",
        "Cabinet-Locked",
        "find the blue cube",
        "cabinet-locked",
        ("blue_cube",),
        lambda ending: found(ending, "blue_cube"),
    ),
    RcTask(
        "cubes-color",
        "Cubes-Color",
        "place the cube with the same colour as the crate on the crate",
        "cubes-color",
        ("red_cube",),
        lambda ending: rests_on(ending, "red_cube", "red_crate"),
    ),
    RcTask(
        "cubes-blocked",
        "Cubes-Blocked",
        "place the red cube on the crate",
        "cubes-blocked",
        ("red_cube", "yellow_cube"),
        lambda ending: rests_on(ending, "red_cube", "crate"),
    ),
    RcTask(
        "kitchen-explore",
        "Kitchen-Explore",
        "find the green apple",
        "kitchen-explore",
        ("green_apple", "kettle"),
        lambda ending: found(ending, "green_apple"),
    ),
    RcTask(
        "composite-explore",
        "Composite-Explore",
        "open the stone cabinet; its weight-sensor lock opens when the red cube is put on the weight sensor",
        "composite-explore",
        ("red_cube",),
        lambda ending: opened(ending, "stone_cabinet_door"),
    ),
)
TASKS = {task.name: task for task in _ALL}


def task_named(name: str) -> RcTask:
    """The task of this name.

    Raises:
        ConfigError: There is none.
    """
    if name not in TASKS:
        raise ConfigError(f"the benchmark has no task '{name}'; it has: {', '.join(TASKS)}")
    return TASKS[name]
