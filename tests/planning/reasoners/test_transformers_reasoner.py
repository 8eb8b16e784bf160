"""Language models in this process: loaded from a folder, asked with their template, and faults told in one line."""

import numpy as np
import pytest

from control.errors import ConfigError, ReasonerError
from planning.language.answers import UnusableAnswerError
from planning.reasoners.local_transformers import LocalModelOptions, TransformersReasoner
from planning.reasoners.reasoner import Asker
from tests.support.models.language_models import LONGEST, PATCHES, save_tiny_chat_model, save_tiny_vision_model
from tests.support.models.symbolic_world import Journal


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "tiny"
    save_tiny_chat_model(path)
    return path


def options(folder, **given) -> LocalModelOptions:
    return LocalModelOptions(str(folder), "cpu", offline=True, **{"max_tokens": 24, **given})


def test_a_model_is_asked_with_its_template_and_its_tokens_are_counted(folder):
    log = Journal()
    backend = TransformersReasoner(options(folder), log)
    assert backend.name == f"{folder} (transformers, cpu)"
    assert log.of("model_loaded") == [{"model": str(folder), "device": "cpu", "pictures": False}]
    with pytest.raises(UnusableAnswerError, match="the answer was cut off after 24 tokens; answer more briefly") as cut:
        backend.answer("action_kind", "Is it so?", {})
    role = "You plan for a robot arm. Answer exactly in the form that is asked for, without anything around it."
    asked = f"system: {role}\nuser: Is it so?\nassistant: "
    assert backend.usage.tokens_in == len(asked) + 5  # three beginnings, two ends
    assert backend.usage.tokens_out == 24 and cut.value.text


def test_answers_repeat(folder):
    texts = []
    for _ in range(2):
        with pytest.raises(UnusableAnswerError) as cut:
            TransformersReasoner(options(folder), Journal()).answer("action_kind", "Is it so?", {})
        texts.append(cut.value.text)
    assert texts[0] == texts[1]


def test_an_answer_that_ends_by_itself_is_whole(folder):
    backend = TransformersReasoner(options(folder), Journal())
    backend._model.generation_config.eos_token_id = list(range(5, 300))  # whatever it says first ends its answer
    assert len(backend.answer("action_kind", "Is it so?", {})) <= 1
    assert backend.usage.tokens_out == 1


def test_nonsense_is_asked_for_again_and_then_told(folder):
    log = Journal()
    asker = Asker(TransformersReasoner(options(folder), log), log, tries=2)
    with pytest.raises(ReasonerError, match="gave no usable answer to 'action_kind' in 2 tries"):
        asker.ask("action_kind", {"action": "look"}, str)
    assert len(log.of("malformed")) == 2 and log.of("answer")[1]["tokens_in"] > log.of("answer")[0]["tokens_in"]


def test_a_question_that_is_too_long_is_told(folder):
    backend = TransformersReasoner(options(folder), Journal())
    with pytest.raises(ReasonerError, match=f"takes {LONGEST} with its answer; choose a model that takes more"):
        backend.answer("action_kind", "x" * LONGEST, {})


def test_pictures_are_kept_from_a_model_without_eyes(folder):
    backend = TransformersReasoner(options(folder), Journal())
    lengths = []
    for pictures in ((), ("a picture",)):
        with pytest.raises(UnusableAnswerError):
            backend.answer("perceive_object", "Is it there?", {}, pictures)
        lengths.append(backend.usage.tokens_in)
    assert lengths[0] == lengths[1]


def test_a_model_with_eyes_is_shown_the_pictures(tmp_path):
    save_tiny_vision_model(tmp_path / "eyes")
    log = Journal()
    backend = TransformersReasoner(options(tmp_path / "eyes"), log)
    assert log.of("model_loaded")[0]["pictures"]
    picture = np.zeros((60, 90, 3), np.uint8)
    lengths = []
    for pictures in ((), (picture,), (picture, picture)):
        with pytest.raises(UnusableAnswerError):
            backend.answer("perceive_object", "Is it there?", {}, pictures)
        lengths.append(backend.usage.tokens_in)
    assert [n - lengths[0] for n in lengths] == [0, PATCHES, 2 * PATCHES]


def test_missing_models_and_broken_ones_are_told_early(folder, tmp_path):
    def fault(model, **given):
        with pytest.raises(ReasonerError) as caught:
            TransformersReasoner(options(model, **given), Journal())
        assert "\n" not in str(caught.value)
        return str(caught.value)

    assert "there is no folder" in fault(tmp_path / "none")
    assert "are not on this machine; fetch them once with: .venv/bin/hf download owner/none" in fault("owner/none")
    (tmp_path / "empty").mkdir()
    assert "does not hold a chat model: it has no config.json" in fault(tmp_path / "empty")
    save_tiny_chat_model(tmp_path / "base", template=None)
    assert "has no chat template, so it does not take questions" in fault(tmp_path / "base")
    save_tiny_chat_model(tmp_path / "broken")
    (tmp_path / "broken" / "model.safetensors").write_bytes(b"nothing")
    assert "cannot be loaded as a causal language model" in fault(tmp_path / "broken")
    (tmp_path / "broken" / "model.safetensors").unlink()
    assert "has a config.json but no weights" in fault(tmp_path / "broken")
    with pytest.raises(ConfigError, match="max_tokens of a language model must be 1 or more, not 0"):
        options(folder, max_tokens=0)


def test_a_device_that_is_not_there_is_told(folder):
    with pytest.raises(ReasonerError, match="device 'cuda:77' was asked for"):
        TransformersReasoner(LocalModelOptions(str(folder), "cuda:77", offline=True), Journal())
