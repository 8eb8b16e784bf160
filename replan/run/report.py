"""How a run ended, for people, for JSON and for scorers."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from planning.loop.results import StepRecord
    from replan.run.stopwatch import Part as PartOfTime


@dataclass(frozen=True)
class RunReport:
    """How a run ended.

    Attributes:
        reached: Whether the goal was reached, as judged on a fresh camera frame.
        reason: One sentence for people.
        seconds: Wall time from the goal to the end in [s], without starting a simulated cell.
        steps: Simulated steps spent in the twin.
        motions: Trajectories sent to the robot.
        replans: How often a subtask or the plan was made anew.
        actions: Every step that was tried, in order.
        seconds_by_part: Wall time in [s] by `replan.run.stopwatch.PARTS`; they add up to `seconds`.
        reasoner, detector: Which backends answered and saw, plainly named.
        questions: Answers asked for, repeated ones included.
        tokens: Of language models, asked and answered; 0 for rules.
        cost: Of these tokens, in the currency of the prices that were given; 0 without prices.
        folder: The run's folder.
        exit_code: Of the command.
    """

    reached: bool
    reason: str
    seconds: float
    steps: int
    motions: int
    replans: int
    actions: tuple["StepRecord", ...]
    seconds_by_part: dict["PartOfTime", float]
    reasoner: str
    detector: str
    questions: int
    tokens: int
    cost: float
    folder: Path
    exit_code: int

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        plain = {f.name: getattr(self, f.name) for f in fields(self)}
        actions = [
            {"action": a.action, "kind": a.kind, "ok": a.ok, "cause": a.cause and a.cause.kind} for a in self.actions
        ]
        parts = {part: round(seconds, 3) for part, seconds in self.seconds_by_part.items()}
        return plain | {
            "folder": str(self.folder),
            "seconds": round(self.seconds, 2),
            "actions": actions,
            "seconds_by_part": parts,
        }

    def as_text(self) -> str:
        """For people."""
        word = "reached" if self.reached else "NOT reached"
        asked = f"{self.questions} questions" + (f", {self.tokens} tokens" if self.tokens else "")
        asked += f", cost {self.cost:.4g}" if self.cost else ""
        return (
            f"goal {word}: {self.reason}\n"
            f"  {self.motions} motions, {self.replans} replans, {self.seconds:.1f} s, {self.steps} simulated steps\n"
            f"  reasoner: {self.reasoner} ({asked}); perception: {self.detector}\n"
            f"  record: {self.folder}"
        )
