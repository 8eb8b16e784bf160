"""Which reasoners answer in a run: options checked early, and one place that builds them."""

import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from control.errors import ConfigError
from planning.builtin.reasoner import BuiltinReasoner
from planning.reasoners.cassette import CassetteReasoner, CassetteWriter, RecordingReasoner
from planning.reasoners.noisy import Mistake, NoiseOptions, NoisyReasoner
from planning.reasoners.reasoner import Log, Reasoner
from prompts.contracts import Role

Backend = Literal["builtin", "openai", "transformers", "cassette"]


@dataclass(frozen=True)
class ReasonerOptions:
    """Which language backend answers; the fields are explained by `replan run --help`."""

    backend: Backend = "builtin"
    url: str | None = None
    model: str | None = None
    perceiver_url: str | None = None
    perceiver_model: str | None = None
    key_variable: str = "OPENAI_API_KEY"
    timeout: float = 60.0
    tries: int = 3
    max_tokens: int = 1500
    picture_size: int = 768
    schema: bool = True
    price_in: float = 0.0
    price_out: float = 0.0
    device: str = "auto"
    offline: bool = False
    cassette: Path | None = None
    cassette_any_order: bool = False
    record_cassette: Path | None = None
    noise: float = 0.0
    noise_mistakes: tuple[Mistake, ...] = ()
    noise_roles: tuple[Role, ...] = ()

    def __post_init__(self) -> None:
        if self.backend not in get_args(Backend):
            raise ConfigError(f"there is no reasoner '{self.backend}'; there are {', '.join(get_args(Backend))}")
        if self.backend == "openai" and not (self.url and self.model):
            raise ConfigError(
                "--reasoner openai needs --reasoner-url and --reasoner-model: the address of a server and a model that "
                "it has, for instance --reasoner-url http://127.0.0.1:11434/v1 --reasoner-model qwen3:8b"
            )
        if self.backend == "transformers" and not self.model:
            raise ConfigError("--reasoner transformers needs --reasoner-model: a folder or hub name of a chat model")
        if self.backend == "cassette" and self.cassette is None:
            raise ConfigError("--reasoner cassette needs --cassette: a recorded cassette, or a run's events.jsonl")
        self._refuse_surplus()
        self.noise_options()
        if self.cassette is not None and self.cassette == self.record_cassette:
            raise ConfigError("--cassette and --record-cassette name one file; record to another one")

    def noise_options(self) -> NoiseOptions:
        """Which mistakes are made on purpose.

        Raises:
            ConfigError: No such mistake, or a share outside 0 to 1.
        """
        everything = NoiseOptions(self.noise)
        return NoiseOptions(
            self.noise, self.noise_mistakes or everything.mistakes, self.noise_roles or everything.roles
        )

    def _refuse_surplus(self) -> None:
        """An option that the chosen backend would not look at is a mistake that a person should hear of."""
        given = {
            "--reasoner-url": (self.url, ("openai",)),
            "--reasoner-model": (self.model, ("openai", "transformers")),
            "--perceiver-url": (self.perceiver_url, ("openai",)),
            "--perceiver-model": (self.perceiver_model, ("openai", "transformers")),
            "--cassette": (self.cassette, ("cassette",)),
        }
        for option, (value, backends) in given.items():
            if value is not None and self.backend not in backends:
                raise ConfigError(
                    f"{option} means nothing to --reasoner {self.backend}; it is for --reasoner {' or '.join(backends)}"
                )


def make_reasoners(
    options: ReasonerOptions, seed: int, log: Log, stack: ExitStack, say: Callable[[str], None] = lambda text: None
) -> tuple[Reasoner, Mapping[Role, Reasoner]]:
    """The reasoner that answers, and others for single roles; a server is asked one short question.

    Args:
        options: Which.
        seed: Of the mistakes that are made on purpose.
        log: Gets the backends' events.
        stack: Closes files when it is left.
        say: Progress for people.

    Raises:
        ConfigError: An option that is not valid, or a cassette that cannot be read or written.
        ReasonerError: A server, model, key or package is not there.
    """
    writer = None
    if options.record_cassette is not None:
        writer = CassetteWriter(options.record_cassette)
        stack.callback(writer.close)
    rng = np.random.default_rng(seed)

    def wrapped(reasoner: Reasoner) -> Reasoner:
        if options.noise:
            reasoner = NoisyReasoner(reasoner, options.noise_options(), rng, log)
        return reasoner if writer is None else RecordingReasoner(reasoner, writer)

    default, by_role = _backends(options, log, say)
    return wrapped(default), {role: wrapped(r) for role, r in by_role.items()}


def reasoner_names(default: Reasoner, by_role: Mapping[Role, Reasoner]) -> str:
    """All reasoners of a run, for reports."""
    others = [f"{role}: {r.name}" for role, r in by_role.items() if r.name != default.name]
    return "; ".join((default.name, *others))


def _backends(options: ReasonerOptions, log: Log, say: Callable[[str], None]) -> tuple[Reasoner, dict[Role, Reasoner]]:
    if options.backend == "builtin":
        return BuiltinReasoner(), {}
    if options.backend == "cassette":
        assert options.cassette is not None  # checked with the options
        return CassetteReasoner(options.cassette, options.cassette_any_order), {}
    assert options.model is not None  # checked with the options
    perceives_elsewhere = options.perceiver_url or options.perceiver_model
    perceiver_model = options.perceiver_model or options.model
    if options.backend == "transformers":
        default = _local(options, options.model, log, say)
        return default, {"perceiver": _local(options, perceiver_model, log, say)} if perceives_elsewhere else {}
    default = _server(options, str(options.url), options.model, "reasoner", log, say)
    if not perceives_elsewhere:
        return default, {}
    url = options.perceiver_url or str(options.url)
    return default, {"perceiver": _server(options, url, perceiver_model, "perceiver", log, say)}


def _local(options: ReasonerOptions, model: str, log: Log, say: Callable[[str], None]) -> Reasoner:
    from planning.reasoners.local_transformers import LocalModelOptions, TransformersReasoner

    say(f"loading the language model {model}")
    return TransformersReasoner(
        LocalModelOptions(model, options.device, options.offline, options.max_tokens, options.picture_size), log
    )


def _server(
    options: ReasonerOptions,
    url: str,
    model: str,
    option: Literal["reasoner", "perceiver"],
    log: Log,
    say: Callable[[str], None],
) -> Reasoner:
    from planning.reasoners.openai_server import OpenAIReasoner
    from planning.reasoners.server_options import ServerOptions

    server = ServerOptions(
        url=url,
        model=model,
        key_variable=options.key_variable,
        timeout=options.timeout,
        tries=options.tries,
        max_tokens=options.max_tokens,
        picture_size=options.picture_size,
        schema=options.schema,
        price_in=options.price_in,
        price_out=options.price_out,
        option=option,
    )
    # The only place where a key is read; it goes to the client and into no record.
    reasoner = OpenAIReasoner(server, os.environ.get(options.key_variable) or None, log)
    say(f"asking {reasoner.name} whether it is there")
    reasoner.check()
    return reasoner
