"""Why an action failed: six questions, all answers kept, and a summary that must agree with them."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from control.errors import NoUsableAnswerError
from planning.language.answers import MalformedAnswerError, parse_reasons, parse_sentence, usable_vote
from planning.language.names import mentioned
from planning.loop.verifier import Checker
from planning.reasoners.reasoner import Asker
from prompts.contracts import PHRASINGS


@dataclass(frozen=True)
class Vote:
    """One answer to the question what prevents an action.

    Attributes:
        phrasing: Which of the six wordings, from 1.
        answer: As it was given.
        sentence: With names repaired.
        unusable: Why it does not count, or None.
        blames: Objects that it holds responsible: those that it names beyond the action's own.
    """

    phrasing: int
    answer: str
    sentence: str
    unusable: str | None
    blames: tuple[str, ...]


@dataclass(frozen=True)
class Diagnosis:
    """What all votes come to.

    Attributes:
        votes: All six.
        tally: Votes per blamed object, most first.
        reasons: At most two, the first one about an object with most votes.
        overruled: Whether the planner's summary contradicted the votes to the end and was replaced by a vote.
    """

    votes: tuple[Vote, ...]
    tally: dict[str, int]
    reasons: tuple[str, ...]
    overruled: bool = False


def diagnose(
    action: str,
    objects: Sequence[str],
    facts: Sequence[str],
    measured: Sequence[str],
    asker: Asker,
    verifier: Checker,
    log,
    images: Sequence[Any] = (),
) -> Diagnosis:
    """Ask six times, repair names, tally, summarise.

    Args:
        action: The step that failed.
        objects: Names in view.
        facts: What is seen, from `planning.loop.perceiver.describe`.
        measured: What the attempt itself reported, from `planning.language.memory.cause_sentences`.
        asker, verifier: Of the run.
        log: Gets `vote` six times and `diagnosis` once.
        images: Fresh pictures.
    """
    votes = tuple(_vote(k, action, objects, facts, measured, asker, verifier, images) for k in range(1, PHRASINGS + 1))
    for vote in votes:
        log("vote", action=action, vote=vote)
    usable = [v for v in votes if v.unusable is None]
    counts = Counter(name for v in usable for name in v.blames)
    tally = dict(sorted(counts.items(), key=lambda item: -item[1]))
    reasons, overruled = _summary(action, usable, tally, asker) if usable else ((), False)
    diagnosis = Diagnosis(votes, tally, reasons, overruled)
    log("diagnosis", action=action, tally=tally, reasons=reasons, overruled=overruled)
    return diagnosis


def _vote(
    phrasing: int,
    action: str,
    objects: Sequence[str],
    facts: Sequence[str],
    measured: Sequence[str],
    asker: Asker,
    verifier: Checker,
    images: Sequence[Any],
) -> Vote:
    fields = {"action": action, "objects": objects, "facts": facts, "measured": measured, "phrasing": phrasing}
    answer = ""
    try:
        answer = asker.ask("diagnose_failure", fields, parse_sentence, images)
        sentence = verifier.repair_names(answer, objects)
    except NoUsableAnswerError as error:  # one lost vote of six does not end a run
        return Vote(phrasing, answer, answer, str(error), ())
    unusable = usable_vote(sentence, objects)
    return Vote(phrasing, answer, sentence, unusable, () if unusable else blamed(sentence, action, objects))


def blamed(sentence: str, action: str, objects: Sequence[str]) -> tuple[str, ...]:
    """Objects that a diagnosis holds responsible.

    Names beyond those of the action; if there are none, the action's own ("the door is locked"), unless the sentence
    says that nothing is the matter.
    """
    if sentence.lower().lstrip().startswith(("nothing", "no object", "none")):
        return ()
    named = mentioned(sentence, objects)
    own = set(mentioned(action, objects))
    return tuple(n for n in named if n not in own) or tuple(named)


def _summary(action: str, usable: Sequence[Vote], tally: dict[str, int], asker: Asker) -> tuple[tuple[str, ...], bool]:
    most = max(tally.values(), default=0)
    leaders = [name for name, count in tally.items() if count == most]

    def parse(text: str) -> tuple[str, ...]:
        reasons = parse_reasons(text)
        if leaders and not mentioned(reasons[0], leaders):
            raise MalformedAnswerError(
                f"the first reason is not what most explanations say: {most} of {len(usable)} name "
                f"{' or '.join(leaders)}"
            )
        return reasons

    fields = {"action": action, "explanations": [v.sentence for v in usable]}
    try:
        return asker.ask("summarize_failure", fields, parse), False
    except NoUsableAnswerError:
        # The votes stand, whatever their summary says.
        if not leaders:
            return (), True
        return (next(v.sentence for v in usable if leaders[0] in v.blames),), True
