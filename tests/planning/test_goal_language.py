"""The small language of goals, and which object words mean."""

import pytest

from control.errors import GoalError
from planning.language.goal_language import NotUnderstoodError, mentioned_phrases, parse_goal, parse_step
from planning.language.names import AmbiguousName, MissingName, closest, mentioned, resolve, with_names


@pytest.mark.parametrize(
    ("goal", "kind", "subject", "target"),
    [
        ("place the red cube on the crate", "place", "red cube", "crate"),
        ("Put an apple into the bowl.", "place", "apple", "bowl"),
        ("please stack the red cube on top of the yellow cube", "place", "red cube", "yellow cube"),
        ("could you please move the cup onto the tray?", "place", "cup", "tray"),
        ("move the kettle to the stove", "place", "kettle", "stove"),
        ("move the yellow cube away from the crate", "away", "yellow cube", "crate"),
        ("take the lemon out of the bowl", "away", "lemon", "bowl"),
        ("remove the red_bar from the handles", "away", "red_bar", "handles"),
        ("remove the yellow cube from the top of the crate", "away", "yellow cube", "crate"),
        ("take the cube off the crate", "away", "cube", "crate"),
        ("pick up the apple", "lift", "apple", None),
        ("pick the apple up", "lift", "apple", None),
        ("lift the green cube", "lift", "green cube", None),
        ("find the apple", "find", "apple", None),
        ("look for the banana!", "find", "banana", None),
        ("touch the crate", "reach", "crate", None),
        ("move to the red cube", "reach", "red cube", None),
        ("move the hand to the red cube", "reach", "red cube", None),
        ("open the left door", "open", "left door", None),
        ("open the left door to 80 %", "open", "left door", None),
    ],
)
def test_goals_of_one_clause(goal, kind, subject, target):
    (clause,) = parse_goal(goal).clauses
    assert (clause.kind, clause.subject, clause.target) == (kind, subject, target)
    assert parse_step(clause.as_text()) == clause or clause.kind == "away"
    assert parse_goal(clause.as_text()).clauses[0].as_text() == clause.as_text()


def test_how_far_something_is_to_be_opened_is_understood():
    (clause,) = parse_goal("open the left door to 80 percent").clauses
    assert clause.share == 0.8
    assert clause.as_text() == "open left door to 80 %"
    assert parse_goal("open the left door").clauses[0].share is None


def test_clauses_are_joined_in_order_and_it_means_what_was_named():
    clauses = parse_goal(
        "Take the lemon out of the bowl, then pick up the apple and put it in the bowl; find the pear"
    ).clauses
    assert [(c.kind, c.subject, c.target) for c in clauses] == [
        ("away", "lemon", "bowl"),
        ("lift", "apple", None),
        ("place", "apple", "bowl"),
        ("find", "pear", None),
    ]


@pytest.mark.parametrize(
    ("goal", "part"),
    [
        ("juggle the cubes", "juggle the cubes"),
        ("place the red cube on the crate then dance", "dance"),
        ("place the cube that is red on the crate", "that is red"),
        ("place all cubes on the crate", "all cubes"),
        ("put it on the crate", "it"),
        ("remove the cube", "remove the cube"),
        ("place the crate on the crate", "place the crate on the crate"),
        ("put the cube on the crate near the wall", "near the wall"),
    ],
)
def test_what_is_not_understood_is_named(goal, part):
    with pytest.raises(NotUnderstoodError) as caught:
        parse_goal(goal)
    assert caught.value.part == part
    assert f"cannot understand '{part}' in '{goal}'" in str(caught.value)
    assert '"place X on Y"' in str(caught.value)


@pytest.mark.parametrize("goal", ["", "  ", ".", "then", "please"])
def test_goals_without_words_are_errors(goal):
    with pytest.raises(GoalError):
        parse_goal(goal)


def test_phrases_to_look_for_come_from_any_goal():
    assert mentioned_phrases("place the red cube on the crate") == ("red cube", "crate")
    odd = "arrange the blue cup so that the handle faces the old window"
    assert mentioned_phrases(odd)[0].startswith("blue cup")
    assert mentioned_phrases("juggle") == ()


NAMES = ("red_cube", "yellow_cube", "crate", "apple", "wooden_cabinet", "cup_1", "cup_2")


@pytest.mark.parametrize(
    ("phrase", "name"),
    [
        ("red cube", "red_cube"),
        ("the Red Cube", "red_cube"),
        ("red_cube", "red_cube"),
        ("big red cube", "red_cube"),
        ("ripe apple", "apple"),
        ("cabinet", "wooden_cabinet"),
        ("cup 2", "cup_2"),
    ],
)
def test_words_mean_the_name_that_they_describe(phrase, name):
    assert resolve(phrase, NAMES) == name


@pytest.mark.parametrize(
    "phrase", ["green apple", "green cube", "stone cabinet", "apple pie", "banana", "cup 3", "red"]
)
def test_words_that_say_something_else_mean_nothing_here(phrase):
    with pytest.raises(MissingName, match=f"there is no '{phrase}' in view; in view: red_cube, yellow_cube"):
        resolve(phrase, NAMES)


def test_words_for_several_things_are_ambiguous():
    with pytest.raises(AmbiguousName, match="'cube' may mean red_cube or yellow_cube; say which one"):
        resolve("cube", NAMES)
    with pytest.raises(AmbiguousName, match="'cup' may mean cup_1 or cup_2"):
        resolve("the cup", NAMES)


def test_mentions_are_found_in_both_spellings_and_the_longer_name_wins():
    names = ("cube", "red_cube", "crate")
    assert mentioned("The crate holds the Red Cube.", names) == ["crate", "red_cube"]
    assert mentioned("cubed crates", names) == []
    assert mentioned("a cube and a red_cube", names) == ["cube", "red_cube"]
    assert with_names("The red cube is on the Crate.", names) == "The red_cube is on the crate."


def test_the_closest_name_shares_words_or_letters():
    assert closest("yellow block", NAMES) == "yellow_cube"
    assert closest("aple", NAMES) == "apple"
    assert closest("xylophone", ("cup_1",)) is None


@pytest.mark.parametrize(
    ("goal", "steps"),
    [
        ("open the cabinet", ["open cabinet"]),
        ("Open the left-hand door of the cupboard.", ["open cupboard left door"]),
        ("push the drawer shut", ["close drawer"]),
        ("slide the cabinet open", ["open cabinet"]),
        ("pull the lever down", ["pull lever"]),
        ("clear the crate", ["clear crate"]),
        ("take everything off the crate", ["clear crate"]),
        ("is there a lemon in the microwave?", ["look for lemon in microwave"]),
        ("Is the red block in the cabinet?", ["look for red block in cabinet"]),
        ("make sure the oven door is closed", ["close oven door"]),
        ("Make sure that the apple and the orange are in the bowl.", ["place apple in bowl", "place orange in bowl"]),
        ("I would like the apple in the bowl", ["place apple in bowl"]),
        ("the apple belongs in the bowl", ["place apple in bowl"]),
        ("stow the blue cube in the cabinet and shut it", ["place blue cube in cabinet", "close cabinet"]),
        ("put it on the crate", None),
        ("Wherever the block is, fetch it and put it on the crate.", ["pick up block", "place block on crate"]),
        ("put the cube into the oven, then close its door", ["place cube into oven", "close oven door"]),
        ("find the can and after that put it on the plate", ["look for can", "place can on plate"]),
        ("place the can on the crate and then the cup on the plate", ["place can on crate", "place cup on plate"]),
        ("The ball is behind the door: get it and put it in the bowl.", ["pick up ball", "place ball in bowl"]),
        ("take the yellow cube off the blue one", ["move yellow cube away from blue cube"]),
        ("place the cube with the same colour as the crate on the crate", ["place cube coloured like crate on crate"]),
        ("put the block that matches the crate onto the plate", ["place block coloured like crate onto plate"]),
        ("see whether the door is open", ["see whether door is open"]),
    ],
)  # fmt: skip
def test_many_words_come_down_to_few_steps(goal, steps):
    if steps is None:
        with pytest.raises(NotUnderstoodError, match="nothing was named before it"):
            parse_goal(goal)
        return
    assert [c.as_text() for c in parse_goal(goal).clauses] == steps


@pytest.mark.parametrize(
    ("goal", "what", "step"),
    [
        (
            "open the stone_cabinet; its weight-sensor lock opens when the red_cube is put on it",
            "weight sensor",
            "place red_cube on weight sensor",
        ),
        ("open the oven. It unlocks once the lever is pulled", "it", "pull lever"),
        ("open the oven; the oven opens when the can is placed on the scale", "oven", "place can on scale"),
    ],
)
def test_a_goal_may_tell_what_opens_a_lock(goal, what, step):
    (hint,) = parse_goal(goal).hints
    assert (hint.what, hint.clause.as_text()) == (what, step)


def test_a_hint_that_says_nothing_of_use_is_named():
    with pytest.raises(NotUnderstoodError, match="it does not say what has to be put where, or pulled"):
        parse_goal("open the oven; it opens when the moon is full")
    with pytest.raises(NotUnderstoodError, match="it tells how something opens, but not what to do"):
        parse_goal("the oven opens when the lever is pulled")
