"""A closed set of reward terms, found by their names."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from control.errors import RewardSpecError
from control.tasks.terms.definition import TermDefinition

_NAME = re.compile(r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*")


@dataclass(frozen=True)
class Vocabulary:
    """Terms that specs, programs and prompts may use.

    Attributes:
        definitions: One for each term, in the order in which prompts and documentation list them.

    Raises:
        ValueError: Two terms have one name, or a signature is not one that specs can hold.
    """

    definitions: tuple[TermDefinition, ...]

    def __post_init__(self) -> None:
        names = [d.name for d in self.definitions]
        for definition in self.definitions:
            name = definition.name
            if not _NAME.fullmatch(name):
                raise ValueError(f"'{name}' is no name of a reward term; use lower-case words joined by underscores")
            if names.count(name) > 1:
                raise ValueError(f"two reward terms are named '{name}'; give one of them another name")
            if not 1 <= len(definition.names) <= 2:
                raise ValueError(f"reward term '{name}' has {len(definition.names)} names; specs hold one or two")

    @property
    def names(self) -> tuple[str, ...]:
        """Of all terms."""
        return tuple(d.name for d in self.definitions)

    @property
    def calls(self) -> Mapping[str, TermDefinition]:
        """Terms by the names of their calls in reward programs."""
        return {d.call: d for d in self.definitions}

    @property
    def prompt_lines(self) -> tuple[str, ...]:
        """What a prompt says of each call: its signature, and what it does on a line below."""
        return tuple(f"{d.signature}\n    {d.prompt}" for d in self.definitions)

    def find(self, name: str) -> TermDefinition:
        """The term of this name.

        Raises:
            RewardSpecError: There is none.
        """
        for definition in self.definitions:
            if definition.name == name:
                return definition
        raise RewardSpecError(f"no reward term '{name}'; there are {sorted(self.names)}")
