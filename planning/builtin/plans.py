"""Rules by which the builtin reasoner makes plans.

It knows words and physics, no scenes: what stands in the way goes away first; what is behind a closed door is reached
through the door; what is out of sight may be behind any closed door, the nearest one first; what is locked though
nothing blocks it may be unlocked by a lever that was not pulled yet or by a weight on a plate.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from control.errors import GoalError
from planning.builtin.planner import AWAY_DISTANCE
from planning.builtin.situation import SAME_FAILURES, Situation, opens
from planning.language.goal_language import Clause, Goal, Hint, parse_goal
from planning.language.memory import MOTION_FAILED, FailedAttempt
from planning.language.names import NameProblem, candidates, with_names
from planning.language.scene_facts import WIDE, JointFact

AWAY_SLACK = 0.02  # [m] by which a body may seem nearer than it was put
ENOUGH_TRIES = 3  # failed tries after which another lever, weight or door is tried first

# "X is on Y", "X is in the way", "X blocks ...": X is to blame, and Y says what it must go away from.
_BLAME = re.compile(
    r"(?P<x>\w+) (?:(?:is|lies|stands|sits) (?:already )?"
    r"(?:(?:on top of|on|in front of|inside|in|next to) (?!the way\b)(?:the |an? )?(?P<y>\w+)"
    r"|in the way|too close|blocking)|blocks|occupies|covers|obstructs)"
)
_TOO_CLOSE = re.compile(r"(?:too close to|near|,) '(?P<x>\w+)'")
_CONFIRMED = re.compile(r"(?P<x>\w+)(?: is(?: [\w ]+ and is)?) in the way")


class NothingLeft(GoalError):
    """No rule leads on; the message says what was tried or is missing."""


def make_plan(fields: Mapping[str, Any]) -> str:
    """high_level_plan, replan and new_plan: the goal's clauses as steps, after what they need first."""
    situation = Situation.of(fields)
    try:
        goal = parse_goal(fields["goal"])
        clauses = [meant for clause in _without_lifts(goal.clauses) for meant in situation.meant(clause)]
        rules = _Rules(situation, _hints(goal, situation))
        steps = rules.plan(clauses)
    except (GoalError, NameProblem) as error:
        return _plan_text(str(error), ())
    for step in steps:
        if situation.hopeless(step):
            reason = situation.failures(step)[-1].reason
            return _plan_text(f"'{step}' failed {SAME_FAILURES} times alike. {reason}", ())
    return _plan_text(_thought(situation, clauses, steps), steps)


def _without_lifts(clauses: Sequence[Clause]) -> list[Clause]:
    """Whatever is lifted or taken from somewhere and then put somewhere is moved once."""
    following = [*clauses[1:], None]
    return [
        c
        for c, after in zip(clauses, following, strict=True)
        if not (c.kind in ("lift", "away") and after and after.subject == c.subject and after.kind == "place")
    ]


def _hints(goal: Goal, situation: Situation) -> list[Hint]:
    return [Hint(h.what, situation.meant(h.clause)[0]) for h in goal.hints]


def _thought(situation: Situation, clauses: Sequence[Clause], steps: Sequence[str]) -> str:
    wanted = {c.as_text() for c in clauses}
    first = next((s for s in steps if s not in wanted), None)
    if situation.attempts:
        why = situation.attempts[-1].reason.rstrip(". ").split(". ")[-1]
        return f"{why}, so I {first} first" if first else f"{why}, so I try again"
    return f"Before the goal's own steps I {first}" if first else "The goal says what to do"


def _plan_text(thought: str, steps: Sequence[str]) -> str:
    lines = "".join(f"> {step}\n" for step in steps)
    return f"<thought>{' '.join(thought.split())}</thought>\n[start plan]\n{lines}[end plan]"


class _Rules:
    """Steps for the clauses of a goal in one situation.

    Args:
        situation: What is known.
        hints: What the goal tells about locks.
    """

    def __init__(self, situation: Situation, hints: Sequence[Hint]) -> None:
        self._now = situation
        self._facts = situation.facts
        self._hints = hints

    def plan(self, clauses: Sequence[Clause]) -> list[str]:
        """Steps for all clauses that are still open; where none is, a look that confirms it.

        Raises:
            NothingLeft: No rule leads to one of the clauses.
        """
        done, remaining = Counter(self._now.finished), []
        for clause in clauses:
            if done[clause.as_text()]:
                done[clause.as_text()] -= 1
            elif not self._holds(clause):
                remaining.append(clause)
        if not remaining:
            # Everything was done or held from the start, and yet a plan is asked for: look, or do the last thing again.
            if all(self._holds(c) for c in clauses):
                return [_as_check(c) for c in clauses]
            remaining = list(clauses)
        steps: list[str] = []
        wanted = {c.as_text() for c in clauses}
        for clause in remaining:
            steps += [s for s in self._steps(clause, ()) if s in wanted or s not in steps]
        return steps

    def _holds(self, clause: Clause) -> bool:
        """Whether a clause is seen to hold already."""
        joint = self._facts.joints.get(clause.subject)
        if clause.kind in ("open", "pull"):
            return joint is not None and joint.at_end
        if clause.kind == "close":
            return joint is not None and joint.at_start
        if clause.kind == "place":
            return clause.subject in self._facts.on_or_in(str(clause.target))
        return clause.kind == "clear" and not self._facts.on_or_in(clause.subject)

    def _steps(self, clause: Clause, above: tuple[str, ...]) -> list[str]:
        """A clause's step with everything that has to come before it.

        `above` are the steps that this one prepares, so that two things which need each other do not run in circles.
        """
        step = clause.as_text()
        if step in above:
            return []
        above = (*above, step)
        if clause.kind == "clear":
            loads = self._facts.on_or_in(clause.subject)
            return [s for load in loads for s in self._steps(Clause("away", load, clause.subject), above)]
        if clause.kind == "pull" and self._role(clause.subject) == "plate":
            return self._steps(self._weight_for(self._facts.joints[clause.subject]), above)
        before: list[str] = []
        if clause.kind == "find":
            if not self._now.in_view(clause.subject):
                try:
                    before += self._uncover(clause.subject, clause.target, above)
                except NothingLeft:
                    if self._now.failures(step):
                        raise  # it was looked for, and all that could hide it is open
        elif clause.kind in ("place", "away", "lift", "reach"):
            self._refuse_unmovable(clause)
            for name in clause.phrases:
                if not self._now.in_view(name):
                    before += [*self._uncover(name, None, above), Clause("find", name).as_text()]
            if clause.target is not None:
                before += self._through_doors(clause, above)
        elif clause.kind == "open":
            before += self._unlock(clause.subject, above)
        for removal in self._removals(clause):
            if removal.as_text() not in above:
                before += self._steps(removal, above)
        return [*dict.fromkeys(before), step]

    def _refuse_unmovable(self, clause: Clause) -> None:
        """Raise NothingLeft where something that nobody named is in the way and was tried to be moved in vain."""
        name = clause.subject
        failed = [a for a in self._now.failures(clause.as_text()) if not a.reason.startswith(MOTION_FAILED)]
        if name in self._facts.unnamed and failed and not self._removals(clause):
            x, y, _ = self._facts.centres[name]
            raise NothingLeft(
                f"something unnamed stands at x {x:.2f}, y {y:.2f} m ({name}: {self._facts.seen[name]}) and is in the "
                "way; it could not be moved: take it away, or name it"
            )

    def _role(self, joint: str) -> str | None:
        fact = self._facts.joints.get(joint)
        return None if fact is None else fact.role

    # -- doors ---------------------------------------------------------------------------------------------------

    def _through_doors(self, clause: Clause, above: tuple[str, ...]) -> list[str]:
        """Doors to open before something can be put into furniture or taken out of it."""
        doors = self._facts.doors_of(str(clause.target))
        closed = [d for d in doors if not d.wide]
        if not closed:
            return []
        failed = [a for a in self._now.failures(clause.as_text()) if not a.reason.startswith(MOTION_FAILED)]
        if len(closed) < len(doors) and not failed:
            return []
        return self._open(self._first_door(closed), above)

    def _open(self, door: JointFact, above: tuple[str, ...]) -> list[str]:
        return self._steps(Clause("open", door.name, None, self._how_far(door.name)), above)

    def _how_far(self, door: str) -> str:
        """How far to open a door to get or see through it: all the way, or as far as failures say that it goes."""
        for attempt in reversed(self._now.openings_failed(door)):
            most = re.search(rf"\b{door} can be driven to (\d+) ?% at most", attempt.reason)
            if most and int(most[1]) >= 100 * WIDE:
                return f"to {int(most[1])}"
        return ""

    def _first_door(self, doors: Sequence[JointFact]) -> JointFact:
        """The door to try first: one that did not fail, else the one that failed least."""
        return min(doors, key=lambda d: len(self._now.openings_failed(d.name)))

    def _uncover(self, name: str, place: str | None, above: tuple[str, ...]) -> list[str]:
        """Steps to the nearest closed inside where something may be.

        Raises:
            NothingLeft: All insides are open, or none can be opened.
        """
        closed: dict[str, list[JointFact]] = {}
        for owner in self._facts.furniture:
            doors = [d for d in self._facts.doors_of(owner) if not d.wide]
            # What was opened once has been looked into, even when it was shut again because it was in the way.
            doors = [d for d in doors if not self._now.was_opened(d.name)]
            doors = [d for d in doors if not any(opens(step, d.name) for step in above)]
            if doors and place in (None, owner):
                closed[owner] = doors
        reasons = []

        def order(owner: str) -> tuple[bool, int, bool, float, str]:
            doors = closed[owner]
            tries = min(len(self._now.openings_failed(d.name)) for d in doors)
            looked_into = len(doors) < len(self._facts.doors_of(owner))
            locked = all(self._locked(d.name) for d in doors)
            return locked, tries // ENOUGH_TRIES, looked_into, self._facts.distance(owner), owner

        for owner in sorted(closed, key=order):
            try:
                return self._open(self._first_door(closed[owner]), above)
            except NothingLeft as error:
                reasons.append(str(error))
        seen = ", ".join(n.replace("_", " ") for n in self._now.objects) or "nothing"
        why = f" ({'; '.join(reasons)})" if reasons else ""
        raise NothingLeft(
            f"{name.replace('_', ' ')} is not in view, and nothing is left that may hide it{why}; in view: {seen}"
        )

    # -- locks ---------------------------------------------------------------------------------------------------

    def _locked(self, joint: str) -> bool:
        """Whether a joint was found locked and nothing was tried against it since."""
        found = [a for a in self._now.openings_failed(joint) if f"{joint} is locked" in a.reason]
        return bool(found) and not any(self._unlocks(s) for s in self._now.done_since(found[-1]))

    def _unlocks(self, step: str) -> bool:
        return step in self._mechanism_steps()

    def _mechanism_steps(self) -> set[str]:
        """Every step that works a lever or loads a plate."""
        things = (*self._now.objects, *self._facts.unseen)
        steps = set()
        for joint in self._facts.joints.values():
            if joint.role == "lever":
                steps.add(Clause("pull", joint.name).as_text())
            elif joint.role == "plate":
                steps |= {Clause("place", thing, joint.owner, "on").as_text() for thing in things}
        return steps

    def _unlock(self, joint: str, above: tuple[str, ...]) -> list[str]:
        """Steps that may unlock a joint: what the goal tells, or the nearest lever or plate that was not tried."""
        owner = self._facts.joints[joint].owner if joint in self._facts.joints else joint
        for hint in self._hints:
            others = [n for n in candidates(hint.what, sorted(self._facts.furniture)) if self._facts.doors_of(n)]
            about_another = bool(others) and owner not in others
            done = hint.clause.as_text() in self._now.finished or self._holds(hint.clause)
            root = len(above) == 1  # a door that is opened on the way to the hint's own things is another one
            if not about_another and not done and root:
                return self._steps(hint.clause, above)
        if not self._locked(joint):
            return []
        mechanisms = sorted(
            (j for j in self._facts.joints.values() if j.role in ("lever", "plate")),
            key=lambda j: (self._facts.distance(j.owner, owner), j.name),
        )
        reasons = []
        for mechanism in mechanisms:
            try:
                clause = self._untried(mechanism)
                if clause is not None:
                    return self._steps(clause, above)
            except NothingLeft as error:
                reasons.append(str(error))
        tried = "; ".join(reasons) or "no lever, button or plate that was not tried is in view"
        raise NothingLeft(f"{joint} is locked, and nothing is left that may unlock it: {tried}")

    def _untried(self, mechanism: JointFact) -> Clause | None:
        if mechanism.role == "plate":
            return self._weight_for(mechanism)
        clause = Clause("pull", mechanism.name)
        tries = len(self._now.failures(clause.as_text()))
        used = mechanism.at_end or clause.as_text() in self._now.finished or tries >= ENOUGH_TRIES
        return None if used else clause

    def _weight_for(self, plate: JointFact) -> Clause:
        """Putting an untried loose thing on a plate: the nearest in view, else one that is out of sight.

        Raises:
            NothingLeft: There is none.
        """
        furniture, facts = self._facts.furniture, self._facts
        loose = sorted(
            (n for n in self._now.objects if n not in furniture and n not in facts.unnamed),
            key=lambda n: facts.distance(n, plate.owner),
        )
        for thing in (*loose, *(n for n in facts.unseen if n not in furniture)):
            clause = Clause("place", thing, plate.owner, "on")
            tries = len(self._now.failures(clause.as_text()))
            lies_there = thing in facts.on_or_in(plate.owner)
            if not lies_there and clause.as_text() not in self._now.finished and tries < ENOUGH_TRIES:
                return clause
        raise NothingLeft(f"nothing untried is left to put on {plate.owner}")

    # -- what is in the way --------------------------------------------------------------------------------------

    def _removals(self, clause: Clause) -> list[Clause]:
        """What a clause's failures blame, to be moved away first.

        A body that was moved away as often as it was blamed is out of the way.
        """
        blames = Counter(b for a in self._now.failures(clause.as_text()) for b in set(self._blames(a, clause)))
        finished = Counter(self._now.finished)
        removals = [(Clause("away", body, place), count) for (body, place), count in blames.items()]
        return [
            *(removal for removal, count in removals if finished[removal.as_text()] < count),
            *self._doors_in_the_way(clause),
        ]

    def _doors_in_the_way(self, clause: Clause) -> list[Clause]:
        """Open doors that the last failure found too close, to be shut first."""
        failures = self._now.failures(clause.as_text())
        if not failures or failures[-1].after != self._now.finished:
            return []
        near = {m["x"] for m in _TOO_CLOSE.finditer(failures[-1].reason)}
        doors = [j for j in self._facts.joints.values() if j.name in near and j.role == "door"]
        own = {d.owner for d in self._facts.joints.values() if d.name in clause.phrases} | {*clause.phrases}
        own |= {b for a, _, b in self._facts.relations if a in clause.phrases}  # what it lies in has to stay open
        return [Clause("close", d.name) for d in doors if not d.at_start and d.owner not in own]

    def _blames(self, attempt: FailedAttempt, clause: Clause) -> list[tuple[str, str]]:
        """Pairs of a body to blame and the thing that it must go away from.

        That thing is the one that the body is said to be on, in or before; else the one of the step that it is seen
        nearest to. Where some bodies are said to be in the way, others that are only said to be near are let be.
        """
        if attempt.reason.startswith(MOTION_FAILED):
            return []  # the plan was sound
        own = [self._facts.joints[n].owner if n in self._facts.joints else n for n in clause.phrases]
        reason = with_names(attempt.reason, self._now.objects)
        confirmed = {m["x"] for m in _CONFIRMED.finditer(reason)} & set(self._now.objects)
        places: dict[str, str | None] = {}
        for match in _BLAME.finditer(reason):
            body, place = match["x"], match["y"]
            loose = body in self._now.objects and body not in self._facts.furniture
            if loose and body not in own and (not confirmed or body in confirmed):
                places[body] = place if place in own else places.get(body)
        found = []
        for body, said in places.items():
            gaps = {n: self._facts.distance(body, n) for n in own if n in self._facts.centres}
            place = said or min(gaps, key=lambda n: gaps[n], default=own[-1])
            if place in self._facts.furniture or gaps.get(place, 0.0) < AWAY_DISTANCE - AWAY_SLACK:
                found.append((body, place))
        return found


def _as_check(clause: Clause) -> str:
    """A look that confirms a clause."""
    if clause.kind == "place":
        how = "in" if clause.preposition.startswith("in") else "on"
        return Clause("check", clause.subject, clause.target, how).as_text()
    if clause.kind in ("open", "pull"):
        return Clause("check", clause.subject, None, "open").as_text()
    if clause.kind == "close":
        return Clause("check", clause.subject, None, "closed").as_text()
    return Clause("find", clause.subject).as_text()
