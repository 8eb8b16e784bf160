"""The inputs of a run in a symbolic world."""

from typing import Any

from planning.builtin.reasoner import BuiltinReasoner
from planning.loop.context import RunContext
from tests.support.models.symbolic_world import Journal, World

CUBES = ("crate", "red_cube", "yellow_cube")


def context_of(goal: str, world: World, **given: Any) -> RunContext:
    """A run whose observer, executor and evaluator are the world; whatever is given comes in place of the usual."""
    usual = {
        "reasoner": BuiltinReasoner(),
        "known_names": tuple(world.places),
        "furniture": getattr(world, "furniture", {}),
        "log": Journal(),
    }
    parts = {"observer": world, "executor": world, "evaluator": world.evaluate}
    return RunContext(goal=goal, **parts, **usual | {k: v for k, v in given.items() if v is not None})
