"""Twice thirty goals as people in a lab type them, for the cells in `benchmarks/goals/other_words/`.

Cells and goals of set 1 were written on 2026-11-26 before the planner was run on any of them and without looking at
what it understands. So they measure how far it goes beyond the wordings and scenes that it was made with; a goal that
fails is left as it is.

The planner's language was widened after it had been seen failing on set 1. Set 2 was written after that, on 2026-11-26
as well, for the same cells and of similar difficulty: before the planner was run on any goal of it, and without looking
at the widened language. Once something is changed because of set 2, it is no longer a fair test either.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np

from perception.ground_truth import CellTruth

CELLS = Path(__file__).with_name("other_words")
UNTOUCHED = 0.02  # [m]; how far a thing that the goal gives no reason to touch may have moved
SEATED = 0.006  # [m]; how far from touching a thing may be that rests on another one
OPEN, CLOSED, LOOKED_INTO = 0.5, 0.05, 0.2  # shares of a door's way
PULLED_OUT = 0.12  # [m]; a thing that was fetched out of furniture lies lower than this


def at(truth: CellTruth, name: str) -> np.ndarray:
    """Centre of a thing's box in the world in [m], shape (3,)."""
    return truth.things[name].world_T_object[:3, 3]


def seen_from(truth: CellTruth, frame: str, name: str) -> np.ndarray:
    """Centre of a thing in another's frame in [m], shape (3,)."""
    return truth.things[frame].world_T_object[:3, :3].T @ (at(truth, name) - at(truth, frame))


def half_height(truth: CellTruth, name: str) -> float:
    """Half the height of a box as it lies, in [m]."""
    thing = truth.things[name]
    return float(np.abs(thing.world_T_object[2, :3]) @ thing.extents / 2)


Scorer = Callable[[CellTruth], bool]


def on(top: str, below: str) -> Scorer:
    """The one box rests on the other, its centre above it."""

    def holds(truth: CellTruth) -> bool:
        x, y, _ = np.abs(seen_from(truth, below, top))
        width, depth, _ = truth.things[below].extents / 2
        gap = at(truth, top)[2] - at(truth, below)[2] - half_height(truth, top) - half_height(truth, below)
        return bool(x < width and y < depth and abs(gap) < SEATED)

    return holds


def on_plate(top: str, below: str) -> Scorer:
    """An upright thing stands on a sprung plate."""

    def holds(truth: CellTruth) -> bool:
        x, y, _ = np.abs(seen_from(truth, below, top))
        width, depth, height = truth.things[below].extents / 2
        low = at(truth, top)[2] - half_height(truth, top) - (at(truth, below)[2] + height)
        return bool(x < width and y < depth and -0.02 < low < SEATED)  # a plate goes down by up to 12 mm

    return holds


def on_table(name: str) -> Scorer:
    """A box rests on the table."""
    return lambda truth: bool(abs(at(truth, name)[2] - half_height(truth, name)) < SEATED)


def in_bowl(name: str, bowl: str) -> Scorer:
    """A round thing lies in a bowl and not on its rim."""

    def holds(truth: CellTruth) -> bool:
        aside = np.hypot(*(at(truth, name) - at(truth, bowl))[:2])
        rim = at(truth, bowl)[2] + truth.things[bowl].extents[2] / 2
        return bool(aside < truth.things[bowl].extents[0] / 2 - 0.015 and at(truth, name)[2] < rim + 0.02)

    return holds


def out_of_bowl(name: str, bowl: str) -> Scorer:
    """A round thing lies on the table beside a bowl."""

    def holds(truth: CellTruth) -> bool:
        aside = np.hypot(*(at(truth, name) - at(truth, bowl))[:2])
        return bool(aside > truth.things[bowl].extents[0] / 2 + 0.01 and at(truth, name)[2] < 0.06)

    return holds


def inside(name: str, furniture: str) -> Scorer:
    """A thing's centre is within the furniture's box."""

    def holds(truth: CellTruth) -> bool:
        return bool(np.all(np.abs(seen_from(truth, furniture, name)) < truth.things[furniture].extents / 2 - 0.01))

    return holds


def outside(name: str, furniture: str) -> Scorer:
    """A thing lies low, and not above, below or in the furniture."""

    def holds(truth: CellTruth) -> bool:
        away = np.abs(seen_from(truth, furniture, name))[:2] > truth.things[furniture].extents[:2] / 2
        return bool(away.any() and at(truth, name)[2] < PULLED_OUT)

    return holds


def opened(joint: str, least: float = OPEN) -> Scorer:
    """A door is open by at least this share of its way."""
    return lambda truth: truth.joints[joint].fraction >= least


def closed(joint: str) -> Scorer:
    """A door is shut."""
    return lambda truth: truth.joints[joint].fraction <= CLOSED


def both(*scorers: Scorer) -> Scorer:
    """All of them hold."""
    return lambda truth: all(s(truth) for s in scorers)


@dataclass(frozen=True)
class WordGoal:
    """One goal.

    Attributes:
        goal: As a person types it.
        cell: Name of a file in `CELLS`.
        seed: Of the simulated cell.
        reached: What truly holds at the end; None where the goal must be refused.
        may_move: Loose things that the goal gives reason to move; all others must stay within `UNTOUCHED`.
        refused: Of a refusal: words of which the reason must contain one; empty where a refusal is wrong.
        answer: Of a question: pattern that the reason must match, in lower case; "" where nothing is asked.
        options: Options of the cell that are on.
    """

    goal: str
    cell: str
    seed: int
    reached: Scorer | None = None
    may_move: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    answer: str = ""
    options: tuple[str, ...] = ()

    @property
    def cell_file(self) -> Path:
        """Where the cell is described."""
        return CELLS / f"{self.cell}.yaml"


@dataclass(frozen=True)
class Ending:
    """How a run ended.

    Attributes:
        claimed: Whether the run says that it reached its goal.
        reason: What it says.
        before, after: What truly stood there; None where the run ended before anything was looked at or done.
    """

    claimed: bool
    reason: str
    before: CellTruth | None = None
    after: CellTruth | None = None


def fulfilled(goal: WordGoal, end: Ending) -> tuple[bool, str]:
    """Whether a run ended as it should, and what was wrong ("" if nothing)."""
    text = end.reason.lower().replace("_", " ")
    moved = _moved(end, () if goal.reached is None else goal.may_move)
    if moved:
        return False, f"moved {', '.join(moved)}"
    if goal.refused and not end.claimed and any(re.search(rf"\b{re.escape(w)}\b", text) for w in goal.refused):
        untouched = not _moved(end, ())
        return untouched, "" if untouched else "moved things before it refused"
    if goal.reached is None:
        return False, f"should have been refused with a word of {', '.join(goal.refused)}"
    if end.after is None or not goal.reached(end.after):
        return False, "what should truly hold at the end does not"
    if goal.answer:
        right = re.search(goal.answer, text) is not None
        return right, "" if right else "the answer is not the true one"
    return end.claimed, "" if end.claimed else "reached, but not said to be"


def _moved(end: Ending, may_move: tuple[str, ...]) -> list[str]:
    if end.before is None or end.after is None:
        return []
    before, after = end.before, end.after
    return [n for n in before.poses if n not in may_move and np.linalg.norm(at(after, n) - at(before, n)) > UNTOUCHED]


def _yes(noun: str) -> str:
    """A sentence that speaks of the noun and denies nothing."""
    return rf"^(?!.*\b(no|not|nothing|never|empty|isn't|cannot)\b).*\b{noun}\b"


def _no(noun: str) -> str:
    """A sentence that denies the noun."""
    return rf"\bno {noun}\b|\b{noun}\b.{{0,30}}\b(not|isn't)\b|\b(not|isn't)\b.{{0,30}}\b{noun}\b"


def _meanings(first: str, second: str) -> tuple[str, ...]:
    """What a refusal may say of words that mean either of two things."""
    pairs = ((first, second), (second, first))
    noun = first.split()[-1]
    said = (
        "ambiguous",
        "ambiguity",
        "more than one",
        "several",
        f"two {noun}s",
        f"which {noun}",
        "which one",
        "which of",
    )
    return (*said, *(f"{a} {word} {b}" for a, b in pairs for word in ("or", "and", "or the", "and the")))


@dataclass(frozen=True)
class GoalSet:
    """Goals that were written at one time.

    Attributes:
        written: Day on which they were.
        goals: By name; names are unique over all sets.
    """

    written: date
    goals: dict[str, WordGoal]


GOALS_1: dict[str, WordGoal] = {
    "polite": WordGoal(
        "Could you put the green block onto the blue crate, please?",
        "two-crates",
        0,
        on("green_block", "blue_crate"),
        ("green_block",),
    ),
    "colour_of_a_lemon": WordGoal(
        "I would like the cube with the colour of a lemon on the red crate.",
        "two-crates",
        1,
        on("yellow_cube", "red_crate"),
        ("yellow_cube",),
    ),
    "colour_of_a_crate": WordGoal(
        "Stand the cube that has the same colour as the blue crate on top of the red crate.",
        "two-crates",
        2,
        on("blue_cube", "red_crate"),
        ("blue_cube", "yellow_cube"),
    ),
    "off_the_other": WordGoal(
        "Take the yellow cube off the blue one and put it down on the table.",
        "two-crates",
        3,
        on_table("yellow_cube"),
        ("yellow_cube",),
    ),
    "two_crates": WordGoal(
        "Place the green block on the red crate and then the yellow cube on the blue crate.",
        "two-crates",
        4,
        both(on("green_block", "red_crate"), on("yellow_cube", "blue_crate")),
        ("green_block", "yellow_cube"),
    ),
    "no_such_ball": WordGoal("Lay the purple ball on the red crate.", "two-crates", 1, refused=("purple ball",)),
    "happy": WordGoal("Make the crates happy.", "two-crates", 0, refused=("happy",)),
    "typing_error": WordGoal(
        "put the gren block on the blue crate",
        "two-crates",
        3,
        on("green_block", "blue_crate"),
        ("green_block",),
        refused=("gren", "gren block"),
    ),
    "lemon_out": WordGoal(
        "fetch the lemon out of the bowl",
        "fruit-beside-bowl",
        0,
        out_of_bowl("lemon", "cyan_bowl"),
        ("lemon",),
        options=("lemon_in_bowl",),
    ),
    "two_fruits": WordGoal(
        "Make sure that the apple and the orange are in the bowl.",
        "fruit-beside-bowl",
        1,
        both(in_bowl("red_apple", "cyan_bowl"), in_bowl("orange", "cyan_bowl")),
        ("red_apple", "orange"),
    ),
    "round_red_thing": WordGoal(
        "Drop the round red thing into the bowl.",
        "fruit-beside-bowl",
        2,
        in_bowl("red_apple", "cyan_bowl"),
        ("red_apple",),
    ),
    "lemon_asked_for": WordGoal(
        "Is there a lemon in the bowl?",
        "fruit-beside-bowl",
        3,
        in_bowl("lemon", "cyan_bowl"),
        answer=_yes("lemon"),
        options=("lemon_in_bowl",),
    ),
    "no_lemon_today": WordGoal("Would you put the lemon in the bowl?", "fruit-beside-bowl", 4, refused=("lemon",)),
    "orange_for_lemon": WordGoal(
        "Take the lemon out of the bowl and after that put the orange in.",
        "fruit-beside-bowl",
        2,
        both(out_of_bowl("lemon", "cyan_bowl"), in_bowl("orange", "cyan_bowl")),
        ("lemon", "orange"),
        options=("lemon_in_bowl",),
    ),
    "oven_door": WordGoal("Open the oven door.", "locked-oven", 0, opened("oven_door")),
    "from_the_oven": WordGoal(
        "Get me the green cube from inside the oven and set it down on the crate.",
        "locked-oven",
        1,
        on("green_cube", "red_crate"),
        ("green_cube",),
    ),
    "apple_asked_for": WordGoal(
        "Is there an apple in the oven?", "locked-oven", 2, opened("oven_door", LOOKED_INTO), answer=_no("apple")
    ),
    "lemon_out_of_cupboard": WordGoal(
        "Please bring the lemon out of the cupboard.",
        "weighed-cupboard",
        0,
        outside("lemon", "cupboard"),
        ("lemon", "red_can"),
    ),
    "stow_and_shut": WordGoal(
        "Stow the blue cube in the cabinet and shut it.",
        "weighed-cupboard",
        1,
        both(inside("blue_cube", "cupboard"), closed("cupboard_door")),
        ("blue_cube", "red_can"),
    ),
    "can_on_scale": WordGoal(
        "Set the can on the scale.", "weighed-cupboard", 2, on_plate("red_can", "scale"), ("red_can",)
    ),
    "wherever_it_is": WordGoal(
        "Wherever the red block is, fetch it and put it on the crate.",
        "two-closed",
        0,
        on("red_block", "blue_crate"),
        ("red_block",),
    ),
    "block_asked_for": WordGoal(
        "Is the red block in the cabinet?", "two-closed", 1, opened("cabinet_door", LOOKED_INTO), answer=_yes("block")
    ),
    "in_and_close": WordGoal(
        "Put the yellow cube into the microwave, then close its door.",
        "two-closed",
        2,
        both(inside("yellow_cube", "microwave"), closed("microwave_door")),
        ("yellow_cube",),
    ),
    "put_away": WordGoal(
        "Put the purple block away in the cupboard.",
        "barred-cabinet",
        0,
        inside("purple_cube", "cabinet"),
        ("purple_cube", "green_bar"),
    ),
    "left_hand_door": WordGoal(
        "Open the left-hand door of the cupboard.", "barred-cabinet", 1, opened("cabinet_left_door"), ("green_bar",)
    ),
    "shut": WordGoal("Shut the microwave.", "open-microwave", 0, closed("microwave_door")),
    "three_parts": WordGoal(
        "Take the apple out of the microwave, put it in the bowl and close the microwave after that.",
        "open-microwave",
        1,
        both(in_bowl("red_apple", "blue_bowl"), closed("microwave_door")),
        ("red_apple",),
    ),
    "slide": WordGoal("Slide the cabinet open.", "sliding-cabinet", 0, opened("cabinet_door")),
    "behind_the_door": WordGoal(
        "The ball is behind the sliding door: get it and put it in the bowl.",
        "sliding-cabinet",
        1,
        in_bowl("blue_ball", "green_bowl"),
        ("blue_ball",),
    ),
    "curtain": WordGoal("Hang the ball up on the curtain.", "sliding-cabinet", 2, refused=("curtain", "hang")),
}

GOALS_2: dict[str, WordGoal] = {
    "not_the_red_one": WordGoal(
        "The green block goes on whichever crate isn't red.",
        "two-crates",
        5,
        on("green_block", "blue_crate"),
        ("green_block",),
    ),
    "green_as_grass": WordGoal(
        "Set the block that is as green as grass atop the red box.",
        "two-crates",
        6,
        on("green_block", "red_crate"),
        ("green_block",),
    ),
    "one_each": WordGoal(
        "The blue crate gets the yellow cube and the red crate gets the green block.",
        "two-crates",
        7,
        both(on("yellow_cube", "blue_crate"), on("green_block", "red_crate")),
        ("yellow_cube", "green_block"),
    ),
    "free_it_first": WordGoal(
        "First free the blue cube, then it goes onto the red crate.",
        "two-crates",
        8,
        on("blue_cube", "red_crate"),
        ("blue_cube", "yellow_cube"),
    ),
    "which_cube": WordGoal(
        "Move the cube over to the red crate.", "two-crates", 9, refused=_meanings("blue cube", "yellow cube")
    ),
    "arrow": WordGoal("orange -> bowl, thanks", "fruit-beside-bowl", 5, in_bowl("orange", "cyan_bowl"), ("orange",)),
    "violet_in_dish": WordGoal(
        "Pop the violet ball in the dish.",
        "fruit-beside-bowl",
        6,
        in_bowl("purple_ball", "cyan_bowl"),
        ("purple_ball",),
    ),
    "exchange": WordGoal(
        "Exchange the lemon in the bowl for the apple.",
        "fruit-beside-bowl",
        7,
        both(out_of_bowl("lemon", "cyan_bowl"), in_bowl("red_apple", "cyan_bowl")),
        ("lemon", "red_apple"),
        options=("lemon_in_bowl",),
    ),
    "something_in_bowl": WordGoal(
        "Is there already something in the bowl?",
        "fruit-beside-bowl",
        8,
        in_bowl("lemon", "cyan_bowl"),
        answer=rf"{_yes('lemon')}|^yes\b|\bnot empty\b",
        options=("lemon_in_bowl",),
    ),
    "banana": WordGoal("The banana belongs in the bowl.", "fruit-beside-bowl", 9, refused=("banana",)),
    "should_be_sitting": WordGoal(
        "The green cube should be sitting on the crate.",
        "locked-oven",
        3,
        on("green_cube", "red_crate"),
        ("green_cube",),
    ),
    "left_in_oven": WordGoal(
        "Has someone left the green cube in the oven?",
        "locked-oven",
        4,
        opened("oven_door", LOOKED_INTO),
        answer=_yes("cube"),
    ),
    "oven_shut_afterwards": WordGoal(
        "Have the green cube out of the oven and on the crate, and the oven shut afterwards.",
        "locked-oven",
        5,
        both(on("green_cube", "red_crate"), closed("oven_door")),
        ("green_cube",),
    ),
    "bake": WordGoal("Bake the cube at 200 degrees.", "locked-oven", 6, refused=("bake", "200", "degrees")),
    "lemon_out_here": WordGoal(
        "I need the lemon out here on the table.",
        "weighed-cupboard",
        3,
        outside("lemon", "cupboard"),
        ("lemon", "red_can"),
    ),
    "hide": WordGoal(
        "Hide the blue cube in the cupboard.",
        "weighed-cupboard",
        4,
        inside("blue_cube", "cupboard"),
        ("blue_cube", "red_can"),
    ),
    "weighing_plate": WordGoal(
        "Put the tin onto the weighing plate.", "weighed-cupboard", 5, on_plate("red_can", "scale"), ("red_can",)
    ),
    "replace_lemon": WordGoal(
        "Replace the lemon in the cupboard with the blue cube.",
        "weighed-cupboard",
        6,
        both(outside("lemon", "cupboard"), inside("blue_cube", "cupboard")),
        ("lemon", "blue_cube", "red_can"),
    ),
    "stack": WordGoal(
        "Stack the red block on the crate.", "two-closed", 3, on("red_block", "blue_crate"), ("red_block",)
    ),
    "load": WordGoal(
        "Load the microwave with the yellow cube.",
        "two-closed",
        4,
        inside("yellow_cube", "microwave"),
        ("yellow_cube",),
    ),
    "where": WordGoal(
        "Where is the red block?",
        "two-closed",
        5,
        opened("cabinet_door", LOOKED_INTO),
        answer=r"\bblock\b:?(?: (?!not\b)\w+){0,5} cabinet\b|^(?:it is )?in(?:side)? the cabinet\b",
    ),
    "transfer": WordGoal(
        "Transfer the red block from the cabinet to the microwave.",
        "two-closed",
        6,
        inside("red_block", "microwave"),
        ("red_block",),
    ),
    "lilac": WordGoal(
        "The lilac cube belongs in the cupboard.",
        "barred-cabinet",
        2,
        inside("purple_cube", "cabinet"),
        ("purple_cube", "green_bar"),
    ),
    "take_bar_away": WordGoal(
        "Remove the bar from the handles of the cabinet.",
        "barred-cabinet",
        3,
        outside("green_bar", "cabinet"),
        ("green_bar",),
    ),
    "fridge": WordGoal("Put the apple in the fridge.", "open-microwave", 2, refused=("fridge", "refrigerator")),
    "citrus": WordGoal(
        "Put the citrus fruit in the blue dish.", "open-microwave", 3, in_bowl("orange", "blue_bowl"), ("orange",)
    ),
    "once_it_is_out": WordGoal(
        "Close up the microwave once the apple is out of it.",
        "open-microwave",
        4,
        both(outside("red_apple", "microwave"), closed("microwave_door")),
        ("red_apple",),
    ),
    "sky_coloured": WordGoal(
        "Let me have the sky-coloured ball in the bowl.",
        "sliding-cabinet",
        3,
        in_bowl("blue_ball", "green_bowl"),
        ("blue_ball",),
    ),
    "push_aside": WordGoal(
        "Push the door aside so that I can see into the cabinet.", "sliding-cabinet", 4, opened("cabinet_door")
    ),
    "juggle": WordGoal("Juggle the ball and the cube.", "sliding-cabinet", 5, refused=("juggle",)),
}

SETS = {1: GoalSet(date(2026, 11, 26), GOALS_1), 2: GoalSet(date(2026, 11, 26), GOALS_2)}
GOALS = {**GOALS_1, **GOALS_2}
