"""Options of language backends."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from planning.reasoners.choice import ReasonerOptions


@dataclass(frozen=True)
class ReasonerFlags:
    """Who answers the questions of planning; see docs/reasoners.md."""

    reasoner: Literal["builtin", "openai", "transformers", "cassette"] = "builtin"
    """`builtin` (rules, without network), `openai` (a server that speaks the OpenAI chat protocol: hosted, vLLM,
    ollama, transformers serve), `transformers` (weights on this machine) or `cassette` (recorded answers)."""
    reasoner_url: str | None = None
    """Address of the server, usually ending with /v1. Prompts and camera pictures are sent there."""
    reasoner_model: str | None = None
    """Model, as the server calls it; for `transformers` a local folder or hub name."""
    perceiver_url: str | None = None
    """Another server for questions about pictures. Default: as --reasoner-url."""
    perceiver_model: str | None = None
    """Another model for questions about pictures. Default: as --reasoner-model."""
    reasoner_key_variable: str = "OPENAI_API_KEY"
    """Environment variable that holds the server's key; servers on one's own machine mostly want none."""
    reasoner_timeout: float = 60.0
    """Longest wait for one answer of a server in [s]."""
    reasoner_tries: int = 3
    """Requests for one answer in all, when a server is busy, breaks off or does not answer in time."""
    reasoner_max_tokens: int = 1500
    """Longest answer; one that is cut off is asked for again."""
    reasoner_picture_size: int = 768
    """Longer edge in pixels of the pictures that are shown to a model."""
    reasoner_schema: bool = True
    """Ask for answers as JSON objects of a schema, where the server offers that."""
    reasoner_price_in: float = 0.0
    """Price of a million tokens asked, for the cost in reports."""
    reasoner_price_out: float = 0.0
    """Price of a million tokens answered."""
    reasoner_device: str = "auto"
    """Where `transformers` runs: auto (CUDA if there is any), cpu, cuda or cuda:1."""
    cassette: Path | None = None
    """Recorded answers: a cassette, or the events.jsonl of a run."""
    cassette_any_order: bool = False
    """Take recorded answers by their question alone, in whatever order the questions come."""
    record_cassette: Path | None = None
    """Write every question and answer to this file as well."""
    answer_noise: float = 0.0
    """Share of the answers, 0 to 1, that are spoiled on purpose by a plausible mistake; to test what catches them."""
    answer_noise_mistakes: tuple[
        Literal[
            "dropped", "other_name", "line_dropped", "steps_swapped", "flipped", "wrong_number", "moved_primary",
            "extra_call", "changed_number",
        ],
        ...,
    ] = ()  # fmt: skip
    """Which mistakes; default all."""
    answer_noise_roles: tuple[Literal["planner", "perceiver", "verifier"], ...] = ()
    """Whose answers; default everybody's."""

    def options(self, offline: bool) -> ReasonerOptions:
        """All of them, checked.

        Args:
            offline: Never ask a model hub.

        Raises:
            ConfigError: Options that do not go together or are out of range.
        """
        from planning.reasoners.choice import ReasonerOptions

        return ReasonerOptions(
            backend=self.reasoner,
            url=self.reasoner_url,
            model=self.reasoner_model,
            perceiver_url=self.perceiver_url,
            perceiver_model=self.perceiver_model,
            key_variable=self.reasoner_key_variable,
            timeout=self.reasoner_timeout,
            tries=self.reasoner_tries,
            max_tokens=self.reasoner_max_tokens,
            picture_size=self.reasoner_picture_size,
            schema=self.reasoner_schema,
            price_in=self.reasoner_price_in,
            price_out=self.reasoner_price_out,
            device=self.reasoner_device,
            offline=offline,
            cassette=self.cassette,
            cassette_any_order=self.cassette_any_order,
            record_cassette=self.record_cassette,
            noise=self.answer_noise,
            noise_mistakes=self.answer_noise_mistakes,
            noise_roles=self.answer_noise_roles,
        )
