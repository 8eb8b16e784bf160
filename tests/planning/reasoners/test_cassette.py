"""Cassettes: what was answered once is answered again, and a run that departs from its cassette says where."""

import json

import pytest

from control.errors import ConfigError, ReasonerError
from planning.builtin.reasoner import BuiltinReasoner
from planning.language.answers import UnusableAnswerError
from planning.loop.loop import run_loop
from planning.reasoners.cassette import CassetteReasoner, CassetteWriter, RecordingReasoner, prompt_hash, read_cassette
from replan.run.episode import Episode
from tests.support.models.run_contexts import CUBES, context_of
from tests.support.models.symbolic_world import Journal, World

GOAL = "place the red cube on the crate"


def blocked() -> World:
    return World({"crate": "table", "red_cube": "table", "yellow_cube": "crate"}, frozenset({"crate"}))


def reach(reasoner, log=None, goal=GOAL, world=None):
    return run_loop(context_of(goal, world or blocked(), reasoner=reasoner, known_names=CUBES, log=log))


def recorded(path):
    """A cassette of a run with a replan; returns the run's result."""
    writer = CassetteWriter(path)
    result = reach(RecordingReasoner(BuiltinReasoner(), writer))
    writer.close()
    assert result.reached and result.replans == 1
    return result


def test_a_recorded_run_is_played_again_without_its_reasoner(tmp_path):
    first = recorded(tmp_path / "a.jsonl")
    cassette, log = CassetteReasoner(tmp_path / "a.jsonl"), Journal()
    again = reach(cassette, log)
    assert (again.reached, again.reason, again.plans) == (True, first.reason, first.plans)
    assert log.of("answer")[0]["reasoner"] == "cassette a.jsonl (recorded: builtin (rules, no language model))"
    assert len(log.of("answer")) == len((tmp_path / "a.jsonl").read_text().splitlines())


def test_the_record_holds_question_hash_answer_and_what_it_took(tmp_path):
    recorded(tmp_path / "a.jsonl")
    line = json.loads((tmp_path / "a.jsonl").read_text().splitlines()[0])
    assert line["contract"] == "high_level_plan" and line["prompt_sha256"] == prompt_hash(line["prompt"])
    assert line["reasoner"] == "builtin (rules, no language model)" and "place red_cube on crate" in line["answer"]
    assert (line["tokens_in"], line["tokens_out"], line["cost"]) == (0, 0, 0.0) and line["seconds"] >= 0


def test_the_events_of_a_run_are_a_cassette_too(tmp_path):
    episode = Episode(tmp_path / "run")
    first = reach(BuiltinReasoner(), episode.log)
    episode.close()
    again = reach(CassetteReasoner(tmp_path / "run" / "events.jsonl"))
    assert again.reached and again.plans == first.plans


def test_another_goal_departs_from_the_cassette_at_its_first_question(tmp_path):
    recorded(tmp_path / "a.jsonl")
    with pytest.raises(ReasonerError) as caught:
        reach(CassetteReasoner(tmp_path / "a.jsonl"), goal="place the yellow cube on the crate")
    told = str(caught.value)
    assert told.startswith(
        f"the run departed from the cassette {tmp_path / 'a.jsonl'} at question 1 ('high_level_plan')"
    )
    asked, had = told.split("the cassette has")
    assert "Goal: place the yellow cube" in asked and "Goal: place the red cube" in had
    assert "record it again with --record-cassette" in told and "--cassette-any-order" in told


def test_a_world_that_goes_another_way_departs_where_it_does(tmp_path):
    recorded(tmp_path / "a.jsonl")
    free = World(dict.fromkeys(CUBES, "table"), frozenset({"crate"}))
    with pytest.raises(ReasonerError, match=r"departed from the cassette .* at question 1 \('high_level_plan'\)"):
        reach(CassetteReasoner(tmp_path / "a.jsonl"), world=free)  # nothing stands on the crate: seen at once
    stuck = blocked()
    stuck.undo = 1
    with pytest.raises(ReasonerError, match=r"departed from the cassette .* at question"):
        reach(CassetteReasoner(tmp_path / "a.jsonl"), world=stuck)


def test_a_question_beyond_the_end_is_told(tmp_path):
    recorded(tmp_path / "a.jsonl")
    lines = (tmp_path / "a.jsonl").read_text().splitlines()
    (tmp_path / "short.jsonl").write_text("\n".join(lines[:3]) + "\n")
    with pytest.raises(ReasonerError, match=r"at question 4: it asks '\w+' and the cassette ends there"):
        reach(CassetteReasoner(tmp_path / "short.jsonl"))


def test_in_any_order_a_question_is_found_by_its_text_alone(tmp_path):
    recorded(tmp_path / "a.jsonl")
    lines = (tmp_path / "a.jsonl").read_text().splitlines()
    (tmp_path / "turned.jsonl").write_text("\n".join(reversed(lines)) + "\n")
    with pytest.raises(ReasonerError, match="departed from the cassette"):
        reach(CassetteReasoner(tmp_path / "turned.jsonl"))
    assert reach(CassetteReasoner(tmp_path / "turned.jsonl", any_order=True)).reached
    with pytest.raises(ReasonerError, match="has no answer to this question of 'high_level_plan'"):
        reach(CassetteReasoner(tmp_path / "turned.jsonl", any_order=True), goal="find the crate")


def test_positions_that_are_measured_a_little_otherwise_matter_to_a_strict_cassette_only(tmp_path):
    class Shifted(World):
        def look(self, names):
            scene = super().look(names)
            for o in scene.objects:
                o.world_T_object.setflags(write=True)
                o.world_T_object[0, 3] -= 0.001
            return scene

    recorded(tmp_path / "a.jsonl")
    world = blocked()
    shifted = Shifted(dict(world.places), world.carriers)
    with pytest.raises(ReasonerError, match=r"at question 1 \('high_level_plan'\): it asks .*0\.399.*has .*0\.400"):
        reach(CassetteReasoner(tmp_path / "a.jsonl"), world=shifted)
    shifted = Shifted(dict(world.places), world.carriers)
    assert reach(CassetteReasoner(tmp_path / "a.jsonl", any_order=True), world=shifted).reached


def test_faults_are_recorded_and_come_again(tmp_path):
    class Faulty:
        name = "faulty"

        def answer(self, contract, prompt, fields, images=()):
            raise UnusableAnswerError("cut off", "ye") if contract == "action_kind" else ReasonerError("no server")

    writer = CassetteWriter(tmp_path / "a.jsonl")
    recording = RecordingReasoner(Faulty(), writer)
    for contract in ("action_kind", "high_level_plan"):
        with pytest.raises((UnusableAnswerError, ReasonerError)):
            recording.answer(contract, "?", {})
    writer.close()
    cassette = CassetteReasoner(tmp_path / "a.jsonl")
    with pytest.raises(UnusableAnswerError, match="cut off") as caught:
        cassette.answer("action_kind", "?", {})
    assert caught.value.text == "ye"
    with pytest.raises(ReasonerError, match="no server"):
        cassette.answer("high_level_plan", "?", {})


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "holds no answers"),
        ("not json\n", "line 1 of the cassette .* is not of the form"),
        ('["list"]\n', "line 1 of the cassette .* is not of the form"),
        ('{"contract": "action_kind", "prompt": "?", "prompt_sha256": "0", "reasoner": "x"}\n', "KeyError: 'answer'"),
        (
            '{"contract": "action_kind", "prompt": "?", "prompt_sha256": "0", "reasoner": "x", "answer": "no"}\n',
            "line 1 of the cassette .* was changed",
        ),
        ('{"event": "answer", "contract": "action_kind", "reasoner": "x", "answer": "no"}\n', "line 1 .*KeyError"),
    ],
)
def test_a_file_that_is_no_cassette_is_refused_with_its_line(tmp_path, text, fault):
    (tmp_path / "a.jsonl").write_text(text)
    with pytest.raises(ConfigError, match=fault):
        read_cassette(tmp_path / "a.jsonl")


def test_a_missing_file_and_one_that_cannot_be_written_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot read the cassette .*: No such file or directory; name one"):
        CassetteReasoner(tmp_path / "none.jsonl")
    with pytest.raises(ConfigError, match=r"cannot write the cassette .*; choose another --record-cassette"):
        CassetteWriter(tmp_path)
