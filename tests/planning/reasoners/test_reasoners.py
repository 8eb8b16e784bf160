"""Which reasoners a run gets: options are checked before anything else, and the parts fit together."""

import json
from contextlib import ExitStack

import pytest

from control.errors import ConfigError, ReasonerError
from planning.loop.loop import run_loop
from planning.reasoners.choice import make_reasoners, reasoner_names
from planning.reasoners.options import ReasonerOptions
from planning.reasoners.usage import UsageLog
from tests.replan.test_command_line import one_line_reason, replan
from tests.support.models.language_server import KEY, MODEL, Status, language_server, unused_address
from tests.support.models.run_contexts import CUBES, context_of
from tests.support.models.symbolic_world import Journal, World

GOAL = "place the red cube on the crate"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"backend": "oracle"}, "there is no reasoner 'oracle'; there are builtin, openai, transformers, cassette"),
        ({"backend": "openai"}, "--reasoner openai needs --reasoner-url and --reasoner-model"),
        ({"backend": "openai", "model": "m"}, "for instance --reasoner-url http://127.0.0.1:11434/v1"),
        ({"backend": "transformers"}, "--reasoner transformers needs --reasoner-model: a folder or hub name"),
        ({"backend": "cassette"}, "--reasoner cassette needs --cassette"),
        ({"url": "http://x"}, "--reasoner-url means nothing to --reasoner builtin; it is for --reasoner openai"),
        ({"model": "x"}, "--reasoner-model means nothing to --reasoner builtin; it is for --reasoner openai or trans"),
        ({"noise": 2.0}, "--answer-noise is a share of the answers, 0 to 1, not 2"),
    ],
)
def test_options_that_do_not_go_together_are_refused(options, words):
    with pytest.raises(ConfigError) as caught:
        ReasonerOptions(**options)
    assert words in str(caught.value)


def test_a_cassette_cannot_be_recorded_over_while_it_is_played(tmp_path):
    with pytest.raises(ConfigError, match="--cassette and --record-cassette name one file"):
        ReasonerOptions("cassette", cassette=tmp_path / "a", record_cassette=tmp_path / "a")


def test_planner_and_perceiver_may_be_on_different_servers():
    with language_server() as server, language_server() as other, ExitStack() as stack:
        options = ReasonerOptions("openai", url=server.url, model=MODEL, perceiver_url=other.url)
        log, said = Journal(), []
        default, by_role = make_reasoners(options, 0, log, stack, said.append)
        assert reasoner_names(default, by_role) == f"{MODEL} at {server.url}; perceiver: {MODEL} at {other.url}"
        assert [len(s.requests) for s in (server, other)] == [1, 1]  # each is asked whether it is there
        assert len(log.of("server_checked")) == 2 and said[0] == f"asking {MODEL} at {server.url} whether it is there"


def test_a_server_that_is_not_there_is_told_before_anything_else():
    with ExitStack() as stack, pytest.raises(ReasonerError, match="no language server answers at"):
        make_reasoners(ReasonerOptions("openai", url=unused_address(), model="m"), 0, Journal(), stack)
    with language_server() as server, ExitStack() as stack:
        options = ReasonerOptions("openai", url=server.url, model=MODEL, perceiver_model="blind")
        with pytest.raises(ReasonerError, match=r"has no model 'blind', .*--perceiver-model"):
            make_reasoners(options, 0, Journal(), stack)


def test_the_key_comes_from_the_variable_that_was_named(monkeypatch):
    monkeypatch.setenv("MY_KEY", KEY)
    with language_server() as server, ExitStack() as stack:
        server.key = KEY
        log = Journal()
        make_reasoners(ReasonerOptions("openai", url=server.url, model=MODEL, key_variable="MY_KEY"), 0, log, stack)
        assert KEY not in json.dumps(log.events)
        with pytest.raises(ReasonerError, match="refused a request without a key \\(OTHER is empty\\)"):
            make_reasoners(ReasonerOptions("openai", url=server.url, model=MODEL, key_variable="OTHER"), 0, log, stack)


def test_recording_noise_and_replay_fit_together(tmp_path):
    """A noisy run is recorded with its noise and played again without any."""

    def reach(options, log):
        world = World({"crate": "table", "red_cube": "table", "yellow_cube": "crate"}, frozenset({"crate"}))
        with ExitStack() as stack:
            default, by_role = make_reasoners(options, 7, log, stack)
            return run_loop(context_of(GOAL, world, reasoner=default, by_role=by_role, log=log))

    log, again = Journal(), Journal()
    options = ReasonerOptions(noise=0.1, noise_mistakes=("dropped",), record_cassette=tmp_path / "a.jsonl")
    first = reach(options, log)
    second = reach(ReasonerOptions("cassette", cassette=tmp_path / "a.jsonl"), again)
    assert first.reached and len(log.of("noise")) > 0 and again.of("noise") == []
    assert (second.reached, second.plans, second.steps) == (first.reached, first.plans, first.steps)
    assert [a["answer"] for a in again.of("answer")] == [a["answer"] for a in log.of("answer")]


def test_what_was_asked_is_counted_by_reasoner_and_contract():
    with language_server() as server, ExitStack() as stack:
        server.acts = ["yes", Status(500, "busy"), "I cannot plan."]
        options = ReasonerOptions("openai", url=server.url, model=MODEL, schema=False, price_in=1.0, price_out=2.0)
        log = UsageLog(Journal())
        default, _ = make_reasoners(options, 0, log, stack)
        world = World(dict.fromkeys(CUBES, "table"), frozenset({"crate"}))
        with pytest.raises(ReasonerError, match="no usable answer to 'high_level_plan' in 3 tries"):
            run_loop(context_of(GOAL, world, reasoner=default, log=log))
        (row,) = log.as_rows()
        assert row["reasoner"] == default.name and row["contract"] == "high_level_plan" and row["seconds"] > 0
        assert (row["questions"], row["malformed"]) == (3, 3)
        assert (row["tokens_in"], row["tokens_out"], row["cost"]) == (300, 30, pytest.approx(3.6e-4))
        assert log.total().questions == 3 and world.specs == []


def test_rules_cost_nothing():
    log = UsageLog(Journal())
    world = World(dict.fromkeys(CUBES, "table"), frozenset({"crate"}))
    run_loop(context_of(GOAL, world, log=log))
    total = log.total()
    assert total.questions > 3 and (total.tokens_in, total.tokens_out, total.cost) == (0, 0, 0.0)


def test_a_run_with_a_server_that_is_not_there_ends_with_one_line_and_its_record(tmp_path):
    address = unused_address()
    arguments = ["--reasoner", "openai", "--reasoner-url", address, "--reasoner-model", "m", "--no-video"]
    process = replan("run", "place the red cube on the crate", *arguments, cwd=tmp_path)
    assert process.returncode == 1
    assert f"no language server answers at {address}" in one_line_reason(process)
    (folder,) = (tmp_path / "runs").iterdir()
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    assert [e["event"] for e in events] == ["run", "server_request", "reasoner_usage", "ended_early"]


def test_a_run_with_options_that_do_not_go_together_is_wrong_usage(tmp_path):
    process = replan("run", "place the red cube on the crate", "--cassette", "a.jsonl", cwd=tmp_path)
    assert process.returncode == 2
    assert "--cassette means nothing to --reasoner builtin; it is for --reasoner cassette" in one_line_reason(process)
