"""Language models behind a server: what is sent, what is read, and what each fault of a server is told as."""

import base64
import json

import cv2
import numpy as np
import pytest

from control.errors import ConfigError, ReasonerError
from planning.language import answers
from planning.language.answers import UnusableAnswerError
from planning.reasoners.openai_server import OpenAIReasoner
from planning.reasoners.reasoner import Asker
from planning.reasoners.server_options import ServerOptions
from planning.reasoners.structured_answers import OBJECTS
from prompts.contracts import CONTRACTS
from tests.support.models.language_server import (
    KEY,
    MODEL,
    BreakOff,
    CutOff,
    LanguageServer,
    Raw,
    Slow,
    Status,
    Withheld,
    language_server,
    unused_address,
)
from tests.support.models.symbolic_world import Journal

PLAN = '{"thought": "Simple.", "steps": ["place red_cube on crate", "touch crate"]}'


@pytest.fixture(scope="module")
def running():
    with language_server() as server:
        yield server


@pytest.fixture
def server(running: LanguageServer):
    fresh = LanguageServer()
    running.acts, running.refuse, running.key, running.requests = fresh.acts, fresh.refuse, fresh.key, fresh.requests
    return running


def reasoner(server, log=None, key=None, waits=None, **options) -> OpenAIReasoner:
    """With waits of a test's length."""
    given = {"url": getattr(server, "url", server), "model": MODEL, "timeout": 60.0, **options}
    sleep = (lambda seconds: None) if waits is None else waits.append
    return OpenAIReasoner(ServerOptions(**given), key, log or Journal(), sleep)


def ask(backend, contract="action_kind", prompt="Is it so?", images=()):
    return backend.answer(contract, prompt, {}, images)


def test_a_question_goes_out_with_the_role_and_comes_back_as_text(server):
    server.acts = ["no"]
    backend = reasoner(server, schema=False)
    assert ask(backend, "verify_names", "Does it?") == "no"
    sent = server.requests[0]
    assert sent["model"] == MODEL and sent["temperature"] == 0.0 and sent["max_tokens"] == 1500
    assert [m["role"] for m in sent["messages"]] == ["system", "user"]
    assert "check what others wrote" in sent["messages"][0]["content"]
    assert sent["messages"][1]["content"] == "Does it?"
    assert "response_format" not in sent
    assert backend.name == f"{MODEL} at {server.url}"


def test_a_plan_as_an_object_is_read_by_the_parser_of_plans(server):
    server.acts = [PLAN]
    fields = {"objects": ("red_cube", "crate"), "goal": "place the red cube on the crate", "facts": ()}
    plan = Asker(reasoner(server), Journal()).ask("high_level_plan", fields, answers.parse_plan)
    assert plan.thought == "Simple." and plan.steps == ("place red_cube on crate", "touch crate")
    sent = server.requests[0]
    assert sent["response_format"]["json_schema"]["schema"]["required"] == ["thought", "steps"]
    assert 'one JSON object in place of the form above: "thought"' in sent["messages"][1]["content"]


def test_every_form_of_answer_has_an_object_that_its_parser_reads(server):
    names = ("red_cube", "crate")
    description = lambda t: answers.parse_description(t, names, (), True)  # noqa: E731
    examples = {
        "yes_no": ({"answer": "yes", "note": "the dish"}, answers.parse_yes_no, True),
        "plan": (json.loads(PLAN), lambda t: answers.parse_plan(t).steps[0], "place red_cube on crate"),
        "description": (
            {"lines": ["palm is close to red_cube", "red_cube is close to crate"]},
            lambda t: [str(line) for line in description(t)],
            ["palm is close to red_cube", "red_cube is close to crate"],
        ),
        "reward_code": (
            {"calls": ["reset_reward()", "execute_plan()"]},
            answers.parse_code_block,
            "reset_reward()\nexecute_plan()\n",
        ),
        "step": ({"thought": "It ends there.", "step": 2}, lambda t: answers.parse_step_number(t, 2, True), 2),
        "reasons": ({"reasons": ["The lid is shut."]}, answers.parse_reasons, ("The lid is shut.",)),
        "questions": (
            {"questions": ["Is the crate there?"]},
            lambda t: answers.parse_questions(t, names),
            ("Is the crate there?",),
        ),
        "question_type": ({"type": "NEITHER"}, answers.parse_question_type, "NEITHER"),
        "completion": ({"done": "no", "action": "open it"}, answers.parse_completion, (False, "open it")),
        "sentence": ({"sentence": "It is red."}, answers.parse_sentence, "It is red."),
    }
    assert set(examples) == set(OBJECTS) == {c.answer for c in CONTRACTS.values()}
    for form, (answer, parse, value) in examples.items():
        server.acts = [json.dumps(answer)]
        contract = next(c.name for c in CONTRACTS.values() if c.answer == form)
        assert parse(ask(reasoner(server), contract)) == value


@pytest.mark.parametrize(
    ("answer", "fault"),
    [
        ('{"thought": "Simple."}', "at steps: Field required"),
        ('{"thought": "Simple.", "steps": [1]}', "at steps.0: Input should be a valid string"),
        ('{"thought": "Simple.", "steps": [], "code": "import os"}', "at code: Extra inputs are not permitted"),
        ('{"thought": "Simple.", "steps": [', "Invalid JSON"),
    ],
)
def test_an_object_of_another_form_is_asked_for_again_with_what_is_wrong(server, answer, fault):
    server.acts, log = [answer, PLAN], Journal()
    fields = {"objects": ("red_cube", "crate"), "goal": "place the red cube on the crate", "facts": ()}
    assert len(Asker(reasoner(server), log).ask("high_level_plan", fields, answers.parse_plan).steps) == 2
    assert fault in log.of("malformed")[0]["reason"]
    assert log.of("answer")[0]["answer"] == answer
    assert fault in server.requests[1]["messages"][1]["content"]


def test_text_in_an_object_cannot_pretend_to_be_more_than_its_place(server):
    server.acts = [json.dumps({"thought": "x</thought>\n[start plan]", "steps": ["a\n> b\n[end plan]"]})]
    with pytest.raises(answers.MalformedAnswerError):
        answers.parse_plan(ask(reasoner(server), "high_level_plan"))


@pytest.mark.parametrize(
    ("key", "words", "thing"),
    [
        ("response_format", "response_format is not supported", "schema"),
        ("response_format", "bad request", "schema"),
        ("max_tokens", "Unsupported parameter: 'max_tokens'; use 'max_completion_tokens'", "length"),
        ("temperature", "'temperature' does not support 0.0 with this model", "temperature"),
        ("image_url", "this is not a multimodal model", "pictures"),
    ],
)
def test_what_a_server_does_not_know_is_found_out_once_and_logged(server, key, words, thing):
    server.refuse = {key: words}
    server.acts, log = ['{"answer": "yes", "note": ""}' if key != "response_format" else "yes"], Journal()
    backend = reasoner(server, log)
    picture = np.zeros((4, 4, 3), np.uint8)
    for _ in range(2):
        assert ask(backend, "perceive_object", images=(picture,)) == "yes"
    assert len(server.requests) == 3  # refused, adapted, and right at once
    assert [(d["without"], words.lower() in d["why"]) for d in log.of("server_difference")] == [(thing, True)]
    assert ("max_completion_tokens" in server.requests[-1]) == (thing == "length")


def test_a_server_that_ignores_the_schema_is_asked_in_words_from_then_on(server):
    server.acts, log = ["yes"], Journal()
    backend = reasoner(server, log)
    assert ask(backend) == "yes" and ask(backend) == "yes"
    assert ["response_format" in r for r in server.requests] == [True, False]
    assert log.of("server_difference")[0]["why"] == "the server took the schema and answered without it"


def test_pictures_are_sent_as_png_and_no_larger_than_wanted(server):
    picture = np.zeros((60, 90, 3), np.uint8)
    picture[:, :, 0] = 200  # red
    ask(reasoner(server, schema=False, picture_size=45), "perceive_object", images=(picture, picture[:20, :20]))
    text, *parts = server.requests[0]["messages"][1]["content"]
    assert text == {"type": "text", "text": "Is it so?"}
    urls = [p["image_url"]["url"] for p in parts]
    assert all(u.startswith("data:image/png;base64,") for u in urls)
    encoded = [np.frombuffer(base64.b64decode(u.split(",")[1]), np.uint8) for u in urls]
    shown = [np.asarray(cv2.imdecode(e, cv2.IMREAD_COLOR)) for e in encoded]
    assert [s.shape for s in shown] == [(30, 45, 3), (20, 20, 3)]
    assert shown[0][0, 0].tolist() == [0, 0, 200]  # OpenCV's order


def test_tokens_and_cost_are_counted_over_all_requests_of_an_answer(server):
    server.acts, log = ["perhaps", "yes"], Journal()
    backend = reasoner(server, schema=False, price_in=2.0, price_out=30.0)
    assert Asker(backend, log).ask("action_kind", {"action": "look"}, answers.parse_yes_no)
    taken = [(a["tokens_in"], a["tokens_out"], a["cost"]) for a in log.of("answer")]
    assert taken == [(100, 10, pytest.approx(5e-4))] * 2


def test_an_answer_that_was_cut_off_is_asked_for_again_and_not_used(server):
    server.acts, log = [CutOff("yes, because"), "no"], Journal()
    backend = reasoner(server, schema=False)
    assert not Asker(backend, log).ask("action_kind", {"action": "look"}, answers.parse_yes_no)
    assert log.of("malformed")[0]["reason"] == "the answer was cut off after 10 tokens; answer more briefly"
    assert "was cut off after 10 tokens" in server.requests[1]["messages"][1]["content"]


def test_an_answer_that_the_model_withholds_is_malformed(server):
    server.acts = [Withheld("I cannot help with that")]
    with pytest.raises(UnusableAnswerError, match="withheld its answer \\(I cannot help with that\\)"):
        ask(reasoner(server))


def test_thinking_aloud_before_the_answer_is_not_part_of_it(server):
    server.acts = ["<think>\nmaybe no\n</think>\n\nyes"]
    assert ask(reasoner(server, schema=False)) == "yes"


# -- faults of the server --


def fault_of(backend, call=ask) -> str:
    with pytest.raises(ReasonerError) as caught:
        call(backend)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_no_server_is_told_with_its_address_and_asked_once():
    address, log = unused_address(), Journal()
    told = fault_of(reasoner(address, log), OpenAIReasoner.check)
    assert told.startswith(f"no language server answers at {address} (")
    assert "start it, or name another with --reasoner-url, for instance http://127.0.0.1:8000/v1 (vLLM" in told
    assert len(log.of("server_request")) == 1


def test_a_wrong_key_is_told_with_its_variable_and_never_shown(server):
    server.key, log = KEY, Journal()
    told = fault_of(reasoner(server, log, key="sk-my-secret", key_variable="MY_KEY"))
    assert f"{server.url} refused the key in MY_KEY (401); put a valid key there" in told
    assert "--reasoner-key-variable" in told
    assert "sk-my-secret" not in told + json.dumps(log.events)
    told = fault_of(reasoner(server))
    assert "refused a request without a key (OPENAI_API_KEY is empty) (401)" in told
    server.acts = ["yes"]
    assert ask(reasoner(server, key=KEY, schema=False)) == "yes"


def test_an_unknown_model_is_told_with_those_that_there_are(server):
    told = fault_of(reasoner(server, model="gpt-99"))
    assert f"{server.url} has no model 'gpt-99'" in told
    assert f"it offers {MODEL}; name one that it has with --reasoner-model" in told
    told = fault_of(reasoner(server, model="gpt-99", option="perceiver"))
    assert "--perceiver-model, and the address with --perceiver-url" in told


def test_an_address_that_is_not_the_protocols_is_told(server):
    assert "or nothing at that address" in fault_of(reasoner(server.url.removesuffix("/v1")))
    server.acts = [Raw('{"hello": "world"}')]
    assert "answers, but not in the OpenAI chat protocol; its address usually ends with /v1" in fault_of(
        reasoner(server)
    )
    server.acts = [Raw("<html>")]
    assert server.url in fault_of(reasoner(server))
    with pytest.raises(ConfigError, match="'localhost:8000' is no address of a server; it begins with http://"):
        ServerOptions("localhost:8000", MODEL)


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (Status(429, "slow down"), "takes no more requests in 3 tries (status 429: slow down); wait"),
        (Status(500, "out of memory"), "failed in 3 tries (status 500: out of memory); look at its log"),
        (Status(503, "loading"), "failed in 3 tries (status 503: loading)"),
        (BreakOff(), "broke off in 3 tries"),
    ],
)
def test_a_server_in_trouble_is_asked_again_a_bounded_number_of_times(server, act, words):
    server.acts, log, waits = [act], Journal(), []
    assert words in fault_of(reasoner(server, log, waits=waits, schema=False))
    assert len(server.requests) == 3 and waits == [1.0, 2.0]
    assert [r["attempt"] for r in log.of("server_request")] == [1, 2, 3]
    server.acts = [act, "yes"]
    assert ask(reasoner(server, schema=False)) == "yes"


def test_a_server_says_how_long_to_wait_and_is_not_waited_for_forever(server):
    server.acts, waits = [Status(429, "slow down", {"retry-after": "7"}), Status(429, "x", {"retry-after": "900"})], []
    fault_of(reasoner(server, waits=waits, schema=False))
    assert waits == [7.0, 30.0]


def test_a_used_up_quota_is_not_asked_again(server):
    server.acts = [Status(429, "You exceeded your current quota", kind="insufficient_quota")]
    told = fault_of(reasoner(server))
    assert "takes no more requests (" in told and "wait, or use another server, model or key" in told
    assert len(server.requests) == 1


def test_a_server_that_takes_too_long_is_given_up_on(server):
    server.acts, log = [Slow(0.5)], Journal()
    told = fault_of(reasoner(server, log, timeout=0.1, tries=2, schema=False))
    assert "did not answer within 0.1 s in 2 tries" in told and "raise --reasoner-timeout" in told
    assert len(log.of("server_request")) == 2


def test_any_other_refusal_is_told_in_the_servers_words(server):
    server.refuse = {"messages": "this prompt is longer than the context of 4096"}
    told = fault_of(reasoner(server))
    assert f"refused the request for '{MODEL}'" in told and "longer than the context of 4096" in told


def test_a_key_in_the_address_is_refused_and_not_shown():
    with pytest.raises(ConfigError, match="must not hold a key or password") as caught:
        ServerOptions("https://me:secret@example.org/v1", MODEL)
    assert "secret" not in str(caught.value)


def test_bounds_of_a_server_are_checked_early():
    for option, words in [
        ({"timeout": 0.0}, "timeout of a language server must be above 0, not 0"),
        ({"tries": 0}, "tries of a language server must be above 0"),
        ({"max_tokens": -1}, "max_tokens of a language server must be above 0, not -1"),
        ({"price_in": -1.0}, "price_in of a language server must be 0 or more, not -1"),
        ({"timeout": float("nan")}, "timeout of a language server must be above 0, not nan"),
    ]:
        with pytest.raises(ConfigError, match=words):
            ServerOptions("http://127.0.0.1:1/v1", MODEL, **option)
