"""Symbolic actions in the smallest language of planners (STRIPS with types), and shortest plans found breadth first.

A fact is a tuple of words, ("rests-on", "red_cube", "crate"); a state is a set of facts. An action may be taken when
all that it needs is in the state; it then takes away what it deletes and adds what it adds.
"""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

Fact = tuple[str, ...]
State = frozenset[Fact]
MAX_STATES = 50_000  # of one search; scenes of a table have a few hundred


class TooManyStatesError(Exception):
    """A symbolic search that was given up; the message says why."""


@dataclass(frozen=True)
class Schema:
    """An action with parameters.

    Attributes:
        name: Of the action.
        parameters: Pairs of a parameter ("?x") and its type.
        needs, adds, deletes: Facts with parameters in them.
        skill: What a robot does for it, with parameters in it; see `planning.baselines.domain`.
    """

    name: str
    parameters: tuple[tuple[str, str], ...]
    needs: tuple[Fact, ...]
    adds: tuple[Fact, ...]
    deletes: tuple[Fact, ...]
    skill: Fact


@dataclass(frozen=True)
class Action:
    """A schema with things in place of its parameters.

    Attributes:
        name: Of the schema.
        arguments: In the order of its parameters.
        needs, adds, deletes: Facts.
        skill: What a robot does for it.
    """

    name: str
    arguments: tuple[str, ...]
    needs: State
    adds: State
    deletes: State
    skill: Fact

    def possible_in(self, state: State) -> bool:
        """Whether it may be taken."""
        return self.needs <= state

    def result(self, state: State) -> State:
        """The state after it; what it adds wins over what it deletes."""
        return (state - self.deletes) | self.adds


@dataclass(frozen=True)
class SymbolicProblem:
    """What a planner is given.

    Attributes:
        types: Parent of each type, None for roots; parents first.
        objects: Type of each object.
        predicates: Types of each predicate's parameters.
        schemas: Actions.
        initial: All that is true at first.
        goal: All that shall be true at the end.
    """

    types: Mapping[str, str | None]
    objects: Mapping[str, str]
    predicates: Mapping[str, tuple[str, ...]]
    schemas: tuple[Schema, ...]
    initial: State
    goal: State

    def is_a(self, name: str, kind: str) -> bool:
        """Whether an object is of a type or of one below it."""
        found: str | None = self.objects[name]
        while found is not None and found != kind:
            found = self.types[found]
        return found is not None

    def action(self, name: str, arguments: Sequence[str]) -> Action:
        """One schema with its arguments.

        Raises:
            KeyError: There is no such schema.
        """
        schema = next((s for s in self.schemas if s.name == name), None)
        if schema is None:
            raise KeyError(f"no action '{name}'; there are {[s.name for s in self.schemas]}")
        return _bound(schema, tuple(arguments))

    def actions(self) -> tuple[Action, ...]:
        """All actions whose needs that never change are met.

        A predicate that no action adds is fixed: what needs it and lacks it at first can never be taken.
        """
        changing = {fact[0] for s in self.schemas for fact in s.adds}
        found = []
        for schema in self.schemas:
            choices = [[o for o in self.objects if self.is_a(o, kind)] for _, kind in schema.parameters]
            for arguments in product(*choices):
                action = _bound(schema, arguments)
                if all(fact in self.initial for fact in action.needs if fact[0] not in changing):
                    found.append(action)
        return tuple(found)


def _bound(schema: Schema, arguments: tuple[str, ...]) -> Action:
    words = {parameter: argument for (parameter, _), argument in zip(schema.parameters, arguments, strict=True)}

    def fill(facts: Iterable[Fact]) -> State:
        return frozenset(tuple(words.get(w, w) for w in fact) for fact in facts)

    return Action(
        schema.name,
        arguments,
        fill(schema.needs),
        fill(schema.adds),
        fill(schema.deletes),
        tuple(words.get(w, w) for w in schema.skill),
    )


def useful(actions: Sequence[Action], goal: State) -> tuple[Action, ...]:
    """Actions that add something which the goal or another useful action needs."""
    wanted = set(goal)
    kept: list[Action] = []
    rest = list(actions)
    while True:
        found = [a for a in rest if a.adds & wanted]
        if not found:
            return tuple(a for a in actions if a in kept)
        kept += found
        rest = [a for a in rest if a not in found]
        wanted |= {fact for a in found for fact in a.needs}


def shortest_plan(
    actions: Sequence[Action], start: State, goal: State, most_states: int = MAX_STATES
) -> tuple[Action, ...] | None:
    """The first of the shortest plans, in the order of `actions`; None when there is none.

    Raises:
        TooManyStatesError: More states than `most_states` would have to be looked at.
    """
    mattering = goal.union(*(a.needs for a in actions))  # what nobody asks for tells no states apart
    moves = [(a, a.adds & mattering, a.deletes & mattering) for a in actions]
    came_from: dict[State, tuple[State, Action] | None] = {start & mattering: None}
    queue = deque(came_from)
    while queue:
        state = queue.popleft()
        if goal <= state:
            plan = []
            step = came_from[state]
            while step is not None:
                plan.append(step[1])
                step = came_from[step[0]]
            return tuple(reversed(plan))
        for action, adds, deletes in moves:
            if action.possible_in(state):
                after = (state - deletes) | adds
                if after not in came_from:
                    came_from[after] = (state, action)
                    queue.append(after)
        if len(came_from) > most_states:
            raise TooManyStatesError(f"the symbolic search saw {most_states} states and did not reach the goal")
    return None
