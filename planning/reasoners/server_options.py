"""Which language server and model answer, and within which bounds. Needs the standard library only."""

from dataclasses import dataclass
from typing import Literal
from urllib.parse import urlsplit

from control.errors import ConfigError

EXAMPLE_URLS = "http://127.0.0.1:8000/v1 (vLLM, transformers serve), http://127.0.0.1:11434/v1 (ollama)"


@dataclass(frozen=True)
class ServerOptions:
    """Which server and model answer, and within which bounds.

    Attributes:
        url: Base of the protocol's addresses; usually ends with /v1.
        model: As the server calls it.
        key_variable: Environment variable that the key was read from, for messages only.
        timeout: For one request, in [s].
        tries: Requests for one answer in all, when the server is busy, breaks off or does not answer in time.
        wait: Before the second request in [s]; doubles each time, unless the server says how long.
        max_tokens: Longest answer; a longer one is cut off by the server and asked for again.
        picture_size: Longer edge of the pictures that are sent, in pixels.
        schema: Whether to ask for answers as objects of a schema, where the server offers that.
        price_in, price_out: Of a million tokens asked and answered.
        option: How the command line's options for this server begin, for messages only.
    """

    url: str
    model: str
    key_variable: str = "OPENAI_API_KEY"
    timeout: float = 60.0
    tries: int = 3
    wait: float = 1.0
    max_tokens: int = 1500
    picture_size: int = 768
    schema: bool = True
    price_in: float = 0.0
    price_out: float = 0.0
    option: Literal["reasoner", "perceiver"] = "reasoner"

    def __post_init__(self) -> None:
        if not self.url.startswith(("http://", "https://")):
            raise ConfigError(f"'{self.url}' is no address of a server; it begins with http://, like {EXAMPLE_URLS}")
        if "@" in urlsplit(self.url).netloc:
            raise ConfigError(
                "the address of a language server must not hold a key or password: it stands in every report; put the "
                "key into an environment variable and name that with --reasoner-key-variable"
            )
        for name, low in (("timeout", 0.0), ("tries", 0), ("max_tokens", 0), ("picture_size", 0)):
            if not getattr(self, name) > low:
                raise ConfigError(f"{name} of a language server must be above {low:g}, not {getattr(self, name):g}")
        for name in ("wait", "price_in", "price_out"):
            if not getattr(self, name) >= 0:
                raise ConfigError(f"{name} of a language server must be 0 or more, not {getattr(self, name):g}")
