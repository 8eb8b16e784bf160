"""Which reasoners answer in a run: the one place that builds them from their options."""

import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Literal

import numpy as np

from planning.builtin.reasoner import BuiltinReasoner
from planning.reasoners.cassette import CassetteReasoner, CassetteWriter, RecordingReasoner
from planning.reasoners.noisy import NoisyReasoner
from planning.reasoners.options import ReasonerOptions
from planning.reasoners.reasoner import Log, Reasoner
from prompts.contracts import Role


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
