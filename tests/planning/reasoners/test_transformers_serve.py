"""A real server of the OpenAI protocol on this machine: `transformers serve` with a tiny model of random weights.

The protocol is real, the answers are nonsense: a run must end safely, with the last fault named and nothing moved.
"""

import importlib.util
import os
import socket
import subprocess
import sys
import urllib.request
from contextlib import ExitStack

import pytest

from control.errors import ReasonerError
from planning.loop.loop import run_loop
from planning.reasoners.choice import make_reasoners
from planning.reasoners.options import ReasonerOptions
from planning.reasoners.usage import UsageLog
from tests.support.models.language_models import save_tiny_chat_model
from tests.support.models.run_contexts import context_of
from tests.support.models.symbolic_world import Journal, World
from tests.support.waiting import until

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("accelerate") is None, reason="transformers serve needs the package accelerate"
)


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """(address, model) of a server that runs until the tests of this file are done."""
    folder = tmp_path_factory.mktemp("served") / "tiny"
    save_tiny_chat_model(folder)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-c", "from transformers.cli.transformers import main; main()", "serve", str(folder)]
    command += ["--host", "127.0.0.1", "--port", str(port), "--device", "cpu"]
    with (folder.parent / "log.txt").open("w") as log:
        process = subprocess.Popen(
            command, stdout=log, stderr=subprocess.STDOUT, env={**os.environ, "HF_HUB_OFFLINE": "1"}
        )
    try:
        assert until(lambda: _healthy(port) or process.poll() is not None, 600.0), "the server did not start"
        assert process.poll() is None, (folder.parent / "log.txt").read_text()[-2000:]
        yield f"http://127.0.0.1:{port}/v1", str(folder)
    finally:
        process.terminate()
        process.wait()


def _healthy(port: int) -> bool:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=2) as answer:
            return answer.status == 200
    except OSError:
        return False


def options(served, **given) -> ReasonerOptions:
    url, model = served
    return ReasonerOptions("openai", url=url, model=model, **{"max_tokens": 40, "timeout": 300.0, **given})


def test_a_run_with_nonsense_ends_with_the_last_fault_and_nothing_moved(served):
    log, journal = Journal(), Journal()
    counting = UsageLog(journal)
    world = World({"crate": "table", "red_cube": "table"}, frozenset({"crate"}))
    with ExitStack() as stack:
        default, by_role = make_reasoners(options(served), 0, log, stack)
        with pytest.raises(ReasonerError) as caught:
            goal = "place the red cube on the crate"
            run_loop(context_of(goal, world, reasoner=default, by_role=by_role, log=counting))
    assert str(caught.value) == (
        f"{served[1]} at {served[0]} gave no usable answer to 'high_level_plan' in 3 tries; the last fault: the answer "
        "was cut off after 40 tokens; answer more briefly"
    )
    assert world.specs == []
    assert len(log.of("server_checked")) == 1 and len(journal.of("malformed")) == 3
    total = counting.total()
    assert total.tokens_out == 3 * 40 and total.tokens_in > 3 * 800 and total.seconds > 0  # a token is a byte


def test_another_model_than_the_one_it_serves_is_told_in_its_words(served):
    with ExitStack() as stack, pytest.raises(ReasonerError, match=r"Server is pinned to .*name one that it has"):
        make_reasoners(ReasonerOptions("openai", url=served[0], model="owner/other"), 0, Journal(), stack)


def test_an_address_without_v1_is_told(served):
    url = served[0].removesuffix("/v1")
    with ExitStack() as stack, pytest.raises(ReasonerError, match="or nothing at that address"):
        make_reasoners(ReasonerOptions("openai", url=url, model=served[1]), 0, Journal(), stack)
