"""A symbolic problem as PDDL, written by unified-planning."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from control.errors import MachineError
from planning.baselines.strips import Fact, SymbolicProblem
from replan_base.parts import install_part


@dataclass(frozen=True)
class PddlText:
    """A problem as planners read it.

    Attributes:
        domain, problem: Contents of the two files.
        originals: Our own name for each name in the text; some had to be changed to be valid there.
    """

    domain: str
    problem: str
    originals: Mapping[str, str]


def write_pddl(symbols: SymbolicProblem, name: str) -> PddlText:
    """Both files of a problem; `name` is that of the problem, and begins that of the domain.

    Raises:
        MachineError: unified-planning is not installed.
    """
    try:
        from unified_planning.io import PDDLWriter
    except ModuleNotFoundError as error:
        raise MachineError(
            f"the method 'pddl' needs the package {error.name}, which is not installed; "
            f"run: {install_part('baselines')}"
        ) from error
    writer = PDDLWriter(_unified(symbols, name))
    domain, problem = writer.get_domain(), writer.get_problem()
    return PddlText(domain, problem, {n: str(item.name) for n, item in writer.nto_renamings.items()})


def _unified(symbols: SymbolicProblem, name: str) -> Any:
    """The problem as unified-planning holds it."""
    from unified_planning.environment import Environment
    from unified_planning.model import Fluent, InstantaneousAction, Object, Problem

    env = Environment()
    env.credits_stream = None
    types: dict[str, Any] = {}
    for kind, parent in symbols.types.items():
        types[kind] = env.type_manager.UserType(kind, None if parent is None else types[parent])
    objects = {n: Object(n, types[kind], env) for n, kind in symbols.objects.items()}
    predicates = {
        n: Fluent(n, env.type_manager.BoolType(), environment=env, **{f"a-{kind}": types[kind] for kind in kinds})
        for n, kinds in symbols.predicates.items()
    }
    problem = Problem(name, env)
    for predicate in predicates.values():
        problem.add_fluent(predicate, default_initial_value=False)
    problem.add_objects(objects.values())

    def expression(fact: Fact, parameters: Mapping[str, Any]) -> Any:
        words = [parameters.get(w) or objects[w] for w in fact[1:]]
        return env.expression_manager.FluentExp(predicates[fact[0]], words)

    for schema in symbols.schemas:
        action = InstantaneousAction(schema.name, _env=env, **{p[1:]: types[kind] for p, kind in schema.parameters})
        parameters = {p: action.parameter(p[1:]) for p, _ in schema.parameters}
        for fact in schema.needs:
            action.add_precondition(expression(fact, parameters))
        for facts, value in ((schema.deletes, False), (schema.adds, True)):
            for fact in facts:
                action.add_effect(expression(fact, parameters), value)
        problem.add_action(action)
    for fact in sorted(symbols.initial):
        problem.set_initial_value(expression(fact, {}), True)
    for fact in sorted(symbols.goal):
        problem.add_goal(expression(fact, {}))
    return problem
