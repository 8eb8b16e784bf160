"""A server on this machine that speaks the OpenAI chat protocol and does what a test tells it to."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import uvicorn
from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse, PlainTextResponse, StreamingResponse

from tests.support.waiting import until

KEY = "sk-right-key"
MODEL = "scripted"


@dataclass
class Status:
    """Answer with an error status."""

    code: int
    message: str
    headers: dict[str, str] = field(default_factory=dict)
    kind: str | None = None


@dataclass
class CutOff:
    """Answer as if the length limit had been hit."""

    text: str


@dataclass
class Withheld:
    """Answer with a refusal of the model."""

    why: str


@dataclass
class Slow:
    """Answer after a while."""

    seconds: float


class BreakOff:
    """Close the connection in the middle of the answer."""


@dataclass
class Raw:
    """Answer with this body, whatever the protocol says."""

    body: str


Act = str | Status | CutOff | Withheld | Slow | BreakOff | Raw


@dataclass
class LanguageServer:
    """What the server does, and what it was asked.

    Attributes:
        acts: What to answer, first one first; the last one stays.
        refuse: Keys of a request that it does not know, each with the words in which it says so.
        key: The one that it wants, or None for any.
        requests: Bodies of all chat requests.
    """

    acts: list[Act] = field(default_factory=lambda: ["yes"])
    refuse: dict[str, str] = field(default_factory=dict)
    key: str | None = None
    url: str = ""
    requests: list[dict[str, Any]] = field(default_factory=list)

    async def chat(self, request: Request):
        body = await request.json()
        self.requests.append(body)
        if self.key and request.headers.get("authorization") != f"Bearer {self.key}":
            return _error(401, f"Incorrect API key provided: {request.headers.get('authorization')}")
        if body["model"] != MODEL:
            return _error(404, f"The model `{body['model']}` does not exist")
        for key, words in self.refuse.items():
            if key in body or (key == "image_url" and "image_url" in str(body["messages"])):
                return _error(400, words)
        act = self.acts.pop(0) if len(self.acts) > 1 else self.acts[0]
        match act:
            case Status():
                return _error(act.code, act.message, act.headers, act.kind)
            case Slow():
                time.sleep(act.seconds)
                return _completion("yes")
            case BreakOff():
                return StreamingResponse(_broken(), headers={"content-length": "1000"}, media_type="application/json")
            case Raw():
                return PlainTextResponse(act.body, media_type="application/json")
            case CutOff():
                return _completion(act.text, finish="length")
            case Withheld():
                return _completion(None, refusal=act.why)
            case str():
                return _completion(act)

    @staticmethod
    async def models():
        return {"object": "list", "data": [{"id": MODEL, "object": "model", "created": 0, "owned_by": "tests"}]}


async def _broken():
    yield b'{"choices": [{"mess'
    raise ConnectionResetError("the test closes the connection here")


def _error(status: int, message: str, headers: dict[str, str] | None = None, kind: str | None = None) -> JSONResponse:
    return JSONResponse({"error": {"message": message, "type": "error", "code": kind}}, status, headers)


def _completion(text: str | None, finish: str = "stop", refusal: str | None = None) -> dict[str, Any]:
    return {
        "id": "1",
        "object": "chat.completion",
        "created": 0,
        "model": MODEL,
        "choices": [
            {
                "index": 0,
                "finish_reason": finish,
                "message": {"role": "assistant", "content": text, "refusal": refusal},
            }
        ],
        "usage": {"prompt_tokens": 100, "completion_tokens": 10, "total_tokens": 110},
    }


@contextmanager
def language_server() -> Iterator[LanguageServer]:
    """The server, listening on a free port of this machine until the block ends."""
    scripted = LanguageServer()
    app = FastAPI()
    app.post("/v1/chat/completions")(scripted.chat)
    app.get("/v1/models")(scripted.models)
    listening = socket.socket()
    listening.bind(("127.0.0.1", 0))
    scripted.url = f"http://127.0.0.1:{listening.getsockname()[1]}/v1"
    server = uvicorn.Server(uvicorn.Config(app, log_level="critical", timeout_graceful_shutdown=1))
    thread = threading.Thread(target=server.run, args=([listening],), daemon=True)
    thread.start()
    assert until(lambda: server.started), "the test's server did not start"
    try:
        yield scripted
    finally:
        server.should_exit = True
        thread.join(10)
        listening.close()


def unused_address() -> str:
    """An address at which nothing listens."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"http://127.0.0.1:{free.getsockname()[1]}/v1"
