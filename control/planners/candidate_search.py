"""Simulating candidates, holding them against reward and safety, and choosing among them.

The choice is lexicographic: success, then clean, then cost.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

from control.path_planning.planning_context import PlanningContext
from control.planners.candidates import Candidate
from control.planners.refinement import vary
from control.safety.residuals import safety_residuals
from control.safety.swept_volume import unseen_on_the_way
from control.simulation.batches import Observer
from control.simulation.motion_recording import Purpose, record_motion
from control.simulation.rollouts import Rollout, commands_for, roll_out
from control.tasks.motion_cost import Score, score_motion
from control.tasks.reward_spec import RewardSpec
from control.twin_model import TwinModel

ENOUGH = 2  # clean successes after which no further candidate is simulated
FIRST = 2  # candidates that are simulated together
STRIDE = 3  # every third state of a rollout (12 ms) is looked at for contacts
# Ways through space that nobody saw: what a share of it costs, and the share above which further candidates are tried.
HIDDEN_COST, OVERHEAD_COST = 5.0, 0.25
MUCH_HIDDEN = 0.02
MOST_FOR_HIDDEN = 6
ROUNDS = 2  # of refinement, only where nothing was clean
VARIED = 8  # variants per round
ELITE = 4
MOST_DOUBTED = 6  # plans that are tried in perturbed twins
# Residuals that only a retimed motion can be held against.
RETIMED_ONLY = ("tracked_hand_speed", "tracked_hand_angular_speed", "pressing_force")
# A rollout rests only briefly at its end; the verdict waits out the whole settling time.
SETTLE_IN_SEARCH = 0.1  # [s]


@dataclass(frozen=True)
class Tried:
    """A candidate that was simulated.

    Attributes:
        candidate: Which one.
        score: How it did.
        rollout: How it went.
        hidden: Share of its way that nobody saw and where something that stands could be; 0 where nobody asks.
    """

    candidate: Candidate
    score: Score
    rollout: Rollout
    hidden: float = 0.0

    @property
    def good(self) -> bool:
        """Whether it succeeded cleanly."""
        return self.score.success and self.score.clean


class Search:
    """The simulated candidates of one search.

    Args:
        context: Its surroundings.
        spec: What to achieve.
        offered: Candidates, promising ones first; drawn as they are needed.
        most: Most of them to simulate.
        nthread: Threads for simulation.
        observe: Told of each batch that is simulated.

    Attributes:
        tried: What was simulated so far.
        steps: Simulated steps spent.
    """

    def __init__(
        self,
        context: PlanningContext,
        spec: RewardSpec,
        offered: Iterator[Candidate],
        most: int,
        nthread: int,
        observe: Observer | None = None,
    ) -> None:
        self.context, self.spec = context, spec
        self._offered, self._most = offered, most
        self._nthread, self._observe = nthread, observe
        self.tried: list[Tried] = []
        self.steps = 0
        table = safety_residuals(replace(context.safety, settle_time=SETTLE_IN_SEARCH))
        self._residuals = tuple(r for r in table if r.name not in RETIMED_ONLY)

    def try_until(self, enough: int = ENOUGH) -> None:
        """Simulate candidates a few at a time until enough of them are clean or none is left.

        Where all of these go through much space that nobody saw, a few more are tried.
        """
        while len(self.tried) < self._most and self._lacks(enough):
            group = list(islice(self._offered, min(FIRST, self._most - len(self.tried))))
            if not group:
                return
            self.tried += self.simulate(group)

    def _lacks(self, enough: int) -> bool:
        good = self.good()
        if len(good) < enough:
            return True
        return len(self.tried) < MOST_FOR_HIDDEN and all(t.hidden > MUCH_HIDDEN for t in good)

    def refine(self) -> None:
        """Vary the best candidates, until something is clean."""
        for _ in range(ROUNDS):
            elite = [t.candidate for t in self.ranked()[:ELITE]]
            fresh = vary(self.context, elite, min(VARIED, self._most))
            self.context.counts["varied"] += len(fresh)
            if fresh:
                self.tried += self.simulate(fresh)
            if self.good():
                return

    def ranked(self) -> list[Tried]:
        """Best first."""
        return sorted(self.tried, key=lambda t: t.score.rank)

    def good(self) -> list[Tried]:
        """Clean successes, best first."""
        return [t for t in self.ranked() if t.good]

    def most_robust(self, variants: Sequence[TwinModel]) -> list[Tried]:
        """Clean successes, those first that succeed in most of the perturbed twins.

        They are tried there one after the other, best first, until one succeeds cleanly in all of them; where none
        does, further candidates are simulated.
        """
        wins: dict[int, int] = {}
        while len(wins) < MOST_DOUBTED:
            doubted = next((t for t in self.good() if id(t) not in wins), None)
            if doubted is None:
                known = len(self.good())
                self.try_until(known + 1)
                if len(self.good()) == known:
                    break
                continue
            wins[id(doubted)] = self._wins(doubted.candidate, variants)
            if wins[id(doubted)] == 2 * len(variants):
                break
        return sorted(self.good(), key=lambda t: (-wins.get(id(t), -1), t.score.rank))

    def simulate(self, group: list[Candidate]) -> list[Tried]:
        """Simulate and judge candidates in the twin."""
        context = self.context
        commands = [commands_for(c.segments, context.twin, context.limits) for c in group]
        rollouts, steps = roll_out([context.twin] * len(group), commands, self._nthread, observe=self._observe)
        self.steps += steps
        return [self._tried(c, r) for c, r in zip(group, rollouts, strict=True)]

    def _tried(self, candidate: Candidate, rollout: Rollout) -> Tried:
        """A simulated candidate with its score, to which ways through space that nobody saw add."""
        twin = self.context.twin
        score = self._score(rollout, twin, candidate)
        if twin.seen is None or self.context.safety.unseen == "allow" or rollout.exploded:
            return Tried(candidate, score, rollout)
        unseen = unseen_on_the_way(twin.seen, rollout.model, rollout.qpos, rollout.time, rollout.commands.held)
        cost = score.cost + HIDDEN_COST * unseen.hidden + OVERHEAD_COST * unseen.overhead
        return Tried(candidate, replace(score, cost=cost), rollout, unseen.hidden)

    def _wins(self, candidate: Candidate, variants: Sequence[TwinModel]) -> int:
        """Points in the perturbed twins: one for a success, one more where it is clean."""
        commands = [commands_for(candidate.segments, v, self.context.limits) for v in variants]
        rollouts, steps = roll_out(variants, commands, self._nthread, observe=self._observe)
        self.steps += steps
        self.context.counts["doubted"] += 1
        scores = [self._score(r, v, candidate) for r, v in zip(rollouts, variants, strict=True)]
        return sum(s.success + (s.success and s.clean) for s in scores)

    def _score(self, rollout: Rollout, twin: TwinModel, candidate: Candidate) -> Score:
        motion = record_motion(rollout, twin, Purpose.of_spec(self.spec, self.context.supports), STRIDE)
        return score_motion(motion, twin, self.spec, self._residuals, self.context.rest_palm, candidate.preference)
