"""One policy for asking: bounded tries, each logged, pictures only where they are needed."""

import pytest

from control.errors import ReasonerError
from planning.answers import parse_yes_no
from planning.reasoner import Asker
from tests.symbolic_world import Journal


class Scripted:
    """Gives answers in order and keeps what it was asked."""

    name = "scripted"

    def __init__(self, *answers: str) -> None:
        self.answers = list(answers)
        self.prompts: list[str] = []
        self.images: list[int] = []

    def answer(self, contract, prompt, fields, images=()) -> str:
        self.prompts.append(prompt)
        self.images.append(len(images))
        return self.answers.pop(0)


def test_a_malformed_answer_is_asked_for_again_with_the_reason():
    reasoner, log = Scripted("perhaps", "yes"), Journal()
    assert Asker(reasoner, log).ask("action_kind", {"action": "look"}, parse_yes_no)
    assert reasoner.prompts[1].startswith(reasoner.prompts[0])
    assert "could not be used: the answer must begin with yes or no" in reasoner.prompts[1]
    assert [event for event, _ in log.events] == ["prompt", "answer", "malformed", "prompt", "answer"]
    assert log.of("answer")[0] == {"contract": "action_kind", "reasoner": "scripted", "attempt": 1, "answer": "perhaps"}


def test_tries_are_bounded_and_the_last_fault_is_told():
    reasoner = Scripted(*["perhaps"] * 5)
    with pytest.raises(
        ReasonerError, match="scripted gave no usable answer to 'action_kind' in 2 tries; the last fault"
    ):
        Asker(reasoner, Journal(), tries=2).ask("action_kind", {"action": "look"}, parse_yes_no)
    assert len(reasoner.prompts) == 2
    with pytest.raises(ValueError, match="tries must be at least 1"):
        Asker(reasoner, Journal(), tries=0)


def test_a_failing_backend_is_not_asked_again_behind_ones_back():
    class Broken(Scripted):
        def answer(self, contract, prompt, fields, images=()) -> str:
            self.prompts.append(prompt)
            raise ReasonerError("the server is gone")

    reasoner = Broken()
    with pytest.raises(ReasonerError, match="the server is gone"):
        Asker(reasoner, Journal()).ask("action_kind", {"action": "look"}, parse_yes_no)
    assert len(reasoner.prompts) == 1


def test_pictures_go_only_with_questions_that_need_them():
    reasoner = Scripted("yes", "yes")
    asker = Asker(reasoner, Journal())
    asker.ask("action_kind", {"action": "look"}, parse_yes_no, images=("picture",))
    asker.ask("perceive_object", {"object": "apple", "facts": ()}, parse_yes_no, images=("picture",))
    assert reasoner.images == [0, 1]
