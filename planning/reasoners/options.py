"""Which language backend answers, and how; checked early. Needs the standard library only."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from control.errors import ConfigError
from planning.reasoners.server_options import ServerOptions
from prompts.contracts import Role

Backend = Literal["builtin", "openai", "transformers", "cassette"]
Mistake = Literal[
    "dropped",
    "other_name",
    "line_dropped",
    "steps_swapped",
    "flipped",
    "wrong_number",
    "moved_primary",
    "extra_call",
    "changed_number",
]


@dataclass(frozen=True)
class NoiseOptions:
    """Which mistakes are made, and how often.

    Attributes:
        rate: Probability of a mistake per answer, 0 to 1.
        mistakes: Which kinds; each answer gets one that its form allows, all equally likely.
        roles: Whose answers.
    """

    rate: float
    mistakes: tuple[Mistake, ...] = get_args(Mistake)
    roles: tuple[Role, ...] = get_args(Role)

    def __post_init__(self) -> None:
        if not 0.0 <= self.rate <= 1.0:
            raise ConfigError(f"--answer-noise is a share of the answers, 0 to 1, not {self.rate:g}")
        for what, given, valid in (
            ("mistake", self.mistakes, get_args(Mistake)),
            ("role", self.roles, get_args(Role)),
        ):
            for name in given:
                if name not in valid:
                    raise ConfigError(f"there is no {what} '{name}'; there are {', '.join(valid)}")


@dataclass(frozen=True)
class ReasonerOptions:
    """Who answers the questions of planning; see docs/reasoners.md.

    Raises:
        ConfigError: On construction, for options that do not go together or are out of range.
    """

    backend: Backend = "builtin"
    """`builtin` (rules, without network), `openai` (a server that speaks the OpenAI chat protocol: hosted, vLLM,
    ollama, transformers serve), `transformers` (weights on this machine) or `cassette` (recorded answers)."""
    url: str | None = None
    """Address of the server, usually ending with /v1. Prompts and camera pictures are sent there."""
    model: str | None = None
    """Model, as the server calls it; for `transformers` a local folder or hub name."""
    perceiver_url: str | None = None
    """Another server for questions about pictures. Default: as --reasoner-url."""
    perceiver_model: str | None = None
    """Another model for questions about pictures. Default: as --reasoner-model."""
    key_variable: str = ServerOptions.key_variable
    """Environment variable that holds the server's key; servers on one's own machine mostly want none."""
    timeout: float = ServerOptions.timeout
    """Longest wait for one answer of a server in [s]."""
    tries: int = ServerOptions.tries
    """Requests for one answer in all, when a server is busy, breaks off or does not answer in time."""
    max_tokens: int = ServerOptions.max_tokens
    """Longest answer; one that is cut off is asked for again."""
    picture_size: int = ServerOptions.picture_size
    """Longer edge in pixels of the pictures that are shown to a model."""
    schema: bool = ServerOptions.schema
    """Ask for answers as JSON objects of a schema, where the server offers that."""
    price_in: float = ServerOptions.price_in
    """Price of a million tokens asked, for the cost in reports."""
    price_out: float = ServerOptions.price_out
    """Price of a million tokens answered."""
    device: str = "auto"
    """Where `transformers` runs: auto (CUDA if there is any), cpu, cuda or cuda:1."""
    offline: bool = False
    """Never ask a model hub for the weights of `transformers`."""
    cassette: Path | None = None
    """Recorded answers: a cassette, or the events.jsonl of a run."""
    cassette_any_order: bool = False
    """Take recorded answers by their question alone, in whatever order the questions come."""
    record_cassette: Path | None = None
    """Write every question and answer to this file as well."""
    noise: float = 0.0
    """Share of the answers, 0 to 1, that are spoiled on purpose by a plausible mistake; to test what catches them."""
    noise_mistakes: tuple[Mistake, ...] = ()
    """Which mistakes; default all."""
    noise_roles: tuple[Role, ...] = ()
    """Whose answers; default everybody's."""

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
