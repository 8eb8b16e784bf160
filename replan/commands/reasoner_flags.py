"""How the options of language backends are spelled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from planning.reasoners.options import Backend, Mistake, ReasonerOptions
from prompts.contracts import Role
from replan.commands.flags import options_in

_named = tyro.conf.arg


@dataclass(frozen=True)
class ReasonerFlags(ReasonerOptions):
    """Who answers the questions of planning; see docs/reasoners.md."""

    backend: Annotated[Backend, _named(name="reasoner")] = ReasonerOptions.backend
    url: Annotated[str | None, _named(name="reasoner-url")] = ReasonerOptions.url
    model: Annotated[str | None, _named(name="reasoner-model")] = ReasonerOptions.model
    key_variable: Annotated[str, _named(name="reasoner-key-variable")] = ReasonerOptions.key_variable
    timeout: Annotated[float, _named(name="reasoner-timeout")] = ReasonerOptions.timeout
    tries: Annotated[int, _named(name="reasoner-tries")] = ReasonerOptions.tries
    max_tokens: Annotated[int, _named(name="reasoner-max-tokens")] = ReasonerOptions.max_tokens
    picture_size: Annotated[int, _named(name="reasoner-picture-size")] = ReasonerOptions.picture_size
    schema: Annotated[bool, _named(name="reasoner-schema")] = ReasonerOptions.schema
    price_in: Annotated[float, _named(name="reasoner-price-in")] = ReasonerOptions.price_in
    price_out: Annotated[float, _named(name="reasoner-price-out")] = ReasonerOptions.price_out
    device: Annotated[str, _named(name="reasoner-device")] = ReasonerOptions.device
    offline: tyro.conf.Suppress[bool] = ReasonerOptions.offline
    noise: Annotated[float, _named(name="answer-noise")] = ReasonerOptions.noise
    noise_mistakes: Annotated[tuple[Mistake, ...], _named(name="answer-noise-mistakes")] = (
        ReasonerOptions.noise_mistakes
    )
    noise_roles: Annotated[tuple[Role, ...], _named(name="answer-noise-roles")] = ReasonerOptions.noise_roles

    def options(self, offline: bool) -> ReasonerOptions:
        """The options.

        Args:
            offline: Never ask a model hub.
        """
        return options_in(self, ReasonerOptions, offline=offline)
