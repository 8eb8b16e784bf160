"""A run looks first where its cell's policy says so: it says why, plays a judged motion, and takes a fresh look."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate, scene
from control.safety.swept_volume import SweptUnseen
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec, RewardTerm
from planning.loop.interfaces import AttemptResult
from replan.run.episode import Episode
from replan.run.film import Film
from replan.run.first_looks import MOST_CLOSER, FirstLooks
from replan.run.motion_finder import BlindWay, JudgedMotion, MotionStart
from replan.run.session import RunSession
from replan.run.stopwatch import Stopwatch
from sim_check.cells.loading import load_cell

FRESH = scene()
FOUND = cast(JudgedMotion, "a motion")
LIFT = RewardSpec((RewardTerm("set_obj_z_position", "red_cube", None, 0.2, primary=True),))
REFUSED = FailureCause("unsafe", "red_cube", "refused", check="unseen_volume")


class Finder:
    """Finds every look, or none."""

    def __init__(self, hidden: float, look: Any = "a look", held: str | None = None) -> None:
        points = np.array([[0.4, 0.0, 0.1], [0.5, 0.0, 0.1]])
        unseen = SweptUnseen(hidden, 0.4, 80.0, None, 1.0, (), points, points + 1.0)
        self.blind: BlindWay | None = BlindWay(cast(Any, SimpleNamespace(held=held)), unseen)
        self.look = look
        self.asked: list[np.ndarray] = []
        self.closer: list[bool] = []

    def twin_of(self, _scene, _start):
        return SimpleNamespace(held=None)

    def find_look(self, _twin, points, _camera, closer=False):
        self.asked.append(points)
        self.closer.append(closer)
        return self.look


class Run:
    """A run in a cell with a policy, and what it said, played and looked at."""

    def __init__(self, tmp_path, finder, policy="avoid", wrist=True) -> None:
        cell = load_cell("cubes").model_copy(update={"unseen": policy})
        if not wrist:
            cell = cell.model_copy(update={"cameras": cell.cameras[:1]})
        self.said, self.played, self.looked, self.anew, self.fresh = [], [], 0, [], FRESH
        self.episode = Episode.create(tmp_path, "looks")
        session = RunSession(
            cast(Any, None), cell, cell.robot.limits(), self.episode, Film(), self.said.append, Stopwatch()
        )
        self.looks = FirstLooks(session, finder, cast(Any, self), self.look_again)

    def play(self, motion) -> AttemptResult:
        self.played.append(motion)
        return AttemptResult(ok=True)

    def start(self):
        return MotionStart(np.zeros(7), 0.08, None)

    def look_again(self, anew=()):
        self.looked += 1
        self.anew.append(tuple(anew))
        return self.fresh


def test_a_way_with_much_unseen_space_is_looked_at_before_it_is_taken(tmp_path):
    finder = Finder(0.42)
    run = Run(tmp_path, finder)
    assert run.looks.along(FOUND) is FRESH
    assert run.played == ["a look"] and run.looked == 1
    assert run.said == ["looks first: 42% of the way was not seen"]
    assert '"looks_first"' in (run.episode.folder / "events.jsonl").read_text()


@pytest.mark.parametrize(
    ("hidden", "policy", "found", "looks"),
    [
        (0.1, "avoid", FOUND, False),
        (0.9, "allow", FOUND, False),
        (0.9, "refuse", FOUND, False),
        (0.1, "refuse", REFUSED, True),
        (0.1, "refuse", replace(REFUSED, check="unseen_overhead"), True),
        (0.1, "refuse", replace(REFUSED, check="arm_clearance"), False),
        (0.9, "avoid", FailureCause("no_candidate", "red_cube", "none"), False),
    ],
)
def test_it_looks_where_the_policy_makes_it_matter_and_nowhere_else(tmp_path, hidden, policy, found, looks):
    finder = Finder(hidden)
    run = Run(tmp_path, finder, policy)
    assert (run.looks.along(found) is FRESH) == looks and bool(run.played) == looks
    if looks:
        # What hangs overhead is looked for above, what stands at its own place.
        assert (finder.asked[0][0, 2] > 1.0) == (found.check == "unseen_overhead")


def known_to(std):
    return scene(estimate("red_cube", (0.4, 0.0, 0.025), (0.05, 0.05, 0.05), std=std))


def test_a_thing_that_is_known_too_badly_is_looked_at_from_nearby_before_it_is_taken(tmp_path):
    finder = Finder(0.0)
    run = Run(tmp_path, finder)
    run.fresh = known_to(0.001)
    assert run.looks.at_things(LIFT, known_to(0.01)) is run.fresh
    assert run.anew == [("red_cube",)] and finder.closer == [True] and len(finder.asked[0]) == 26
    assert run.said == ["looks closer at red_cube, as its place is known to 20 mm only, and the grasp tolerates 13 mm"]
    known = known_to(0.001)
    assert run.looks.at_things(LIFT, known) is known and run.looked == 1


def test_a_thing_that_stays_doubted_is_not_looked_at_for_ever(tmp_path):
    run = Run(tmp_path, Finder(0.0))
    run.fresh = known_to(0.01)
    for _ in range(4):
        run.looks.at_things(LIFT, known_to(0.01))
    assert run.looked == MOST_CLOSER


def test_where_no_look_is_possible_it_says_so_and_nothing_moves(tmp_path):
    run = Run(tmp_path, Finder(0.42, FailureCause("no_candidate", "look", "no free way")))
    assert run.looks.along(FOUND) is None and run.played == []
    assert run.said[-1] == "cannot look there: no free way"
    for name, blind in (
        ("held", Run(tmp_path, Finder(0.42, held="red_cube"))),
        ("bare", Run(tmp_path, Finder(0.42), wrist=False)),
    ):
        assert blind.looks.along(FOUND) is None and blind.said == [], name
    unlooked = Finder(0.42)
    unlooked.blind = None
    assert Run(tmp_path, unlooked).looks.along(FOUND) is None
