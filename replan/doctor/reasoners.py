"""Which language backends can be used: packages, and whether a server that was named answers. Asks no other network."""

import importlib.metadata
import os
from dataclasses import dataclass

from control.errors import StackError
from replan_base.parts import install_part


@dataclass(frozen=True)
class Backend:
    """What is known about one language backend.

    Attributes:
        name: As `--reasoner` calls it.
        here: Whether it can be used.
        detail: Versions, models, or what is missing.
    """

    name: str
    here: bool
    detail: str


def examine_reasoners(server: tuple[str, str | None, str] | None) -> list[Backend]:
    """One line per backend.

    Args:
        server: Address, model or None, and environment variable of the key; None to ask no server.
    """
    return [
        Backend("builtin", True, "rules, without network; no language model"),
        _openai(server),
        _packages(
            "transformers", "perception", ("torch", "transformers"), "local weights: name them with --reasoner-model"
        ),
        Backend("cassette", True, "recorded answers: name a file with --cassette"),
    ]


def _packages(name: str, part: str, packages: tuple[str, ...], use: str) -> Backend:
    versions = []
    for package in packages:
        try:
            versions.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            return Backend(name, False, f"the package {package} is not installed; run: {install_part(part)}")
    return Backend(name, True, f"{', '.join(versions)}; {use}")


def _openai(server: tuple[str, str | None, str] | None) -> Backend:
    found = _packages("openai", "models", ("openai",), "no server asked; name one with --reasoner-url")
    if server is None or not found.here:
        return found
    from planning.reasoners.openai_server import OpenAIReasoner
    from planning.reasoners.server_options import ServerOptions

    url, model, variable = server
    try:
        options = ServerOptions(url, model or "none", variable, timeout=10.0, tries=1)
        reasoner = OpenAIReasoner(options, os.environ.get(variable) or None, lambda event, **data: None)
        if model is not None:
            reasoner.check()
            return Backend("openai", True, f"{model} at {url} answers")
        names = reasoner.models()
    except StackError as error:
        return Backend("openai", False, str(error))
    return Backend("openai", True, f"{url} answers; models: {', '.join(names[:10]) or 'it lists none'}")
