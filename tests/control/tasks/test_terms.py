"""A reward term is one object: whoever uses terms learns all about it from the registry."""

import math
import pickle
import re
from dataclasses import fields, replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from benchmarks.scenes.furniture_twins import cabinet
from benchmarks.scenes.tabletop_twins import arm, cubes
from control.errors import RewardSpecError, TermConflictError, UnknownObjectError
from control.path_planning.collision_filter import free_joint_address
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.planners.sampling_cost import CostWeights, RunningCost
from control.robot.rotations import rolled
from control.safety.limits import SafetyLimits
from control.safety.table import safety_table
from control.tasks.documentation import as_markdown
from control.tasks.posed_object import PosedObject, half_heights
from control.tasks.predicates import judge_term
from control.tasks.reward_spec import RewardSpec, RewardTerm
from control.tasks.subtasks import palm_at, posed_objects, read_subtask
from control.tasks.term_conflicts import refuse_term_conflicts
from control.tasks.terms.definition import NameArgument
from control.tasks.terms.registry import TERMS
from control.tasks.terms.vocabulary import Vocabulary
from planning.builtin.planner import reward_call
from planning.language.answers import MalformedAnswerError
from planning.language.description import line_of, offered_lines, parse_line
from planning.language.reward_program import build_spec, parse_reward_program
from prompts.contracts import render

ROOT = Path(__file__).resolve().parents[3]
HOW_TO = ROOT / "docs" / "how-to" / "add-a-reward-term.md"


def term_of_the_how_to():
    """The class that the page's code defines."""
    (code,) = re.findall(r"```python\n(.*?)```", HOW_TO.read_text(), re.DOTALL)
    space: dict = {"__name__": "object_at_height"}
    exec(compile(code, str(HOW_TO), "exec"), space)
    return space["HoldObjectAtHeight"]


WITH_ONE_MORE = Vocabulary((*TERMS.definitions, term_of_the_how_to()()))
HELD = "hold_obj_at_height_reward(red_cube, 0.2, primary_reward=True)\n{}execute_plan()"


def spec_of(more: str = "") -> RewardSpec:
    program = parse_reward_program(HELD.format(more), ("red_cube", "crate"), (), WITH_ONE_MORE)
    assert not program.drops
    return build_spec(program.calls, 0)


def judge(term: RewardTerm, height: float):
    cube = PosedObject("red_cube", np.eye(4), np.full(3, 0.05))
    cube.pose[2, 3] = height
    return judge_term(term, {"red_cube": cube}, np.zeros(3), np.zeros(3))


def test_the_how_tos_term_is_parsed_from_a_program_and_unknown_without_it():
    term = spec_of().primary
    assert (term.kind, term.subject, term.value, term.primary) == ("hold_obj_at_height", "red_cube", 0.2, True)
    with pytest.raises(MalformedAnswerError, match="there is no call 'hold_obj_at_height_reward'"):
        parse_reward_program(HELD.format(""), ("red_cube",), ())
    with pytest.raises(RewardSpecError, match="no reward term 'hold_obj_at_height'; there are"):
        RewardTerm("hold_obj_at_height", "red_cube", None, 0.2)
    drops = parse_reward_program(
        HELD.format("hold_obj_at_height_reward(crate, 1.5)\n"), ("red_cube", "crate"), (), WITH_ONE_MORE
    ).drops
    assert [d.reason for d in drops] == ["z must be between 0 and 1, not 1.5"]


@pytest.mark.parametrize(("height", "left"), [(0.15, 0.03), (0.19, 0.0), (0.215, 0.0), (0.25, 0.03)])
def test_the_how_tos_term_is_judged(height, left):
    judged = judge(spec_of().primary, height)
    assert judged.met == (left == 0.0) and judged.residual == pytest.approx(left)


def test_the_how_tos_term_is_costed_along_a_motion():
    twin, spec = cubes(), spec_of()
    cost = RunningCost(
        twin, spec, read_subtask(spec), SafetyLimits(), arm(), palm_at(twin, twin.q), CostWeights(hold=0.0)
    )
    address = free_joint_address(twin.model, "red_cube")
    assert address is not None
    heights = [0.025, 0.1, 0.2, 0.3]
    qpos = np.repeat(twin.qpos[None, None], len(heights), axis=0)
    qpos[:, 0, address + 2] = heights
    paid = cost.of(qpos, np.zeros((len(heights), 1, 7)), np.zeros((len(heights), 1), bool))
    smooth = [np.hypot(z - 0.2, 0.01) - 0.01 for z in heights]
    np.testing.assert_allclose(paid - paid[2], smooth, atol=1e-9)


def test_the_how_tos_term_is_refused_in_conflict():
    refuse_term_conflicts(spec_of("hold_obj_at_height_reward(red_cube, 0.23)\n"))
    with pytest.raises(TermConflictError) as error:
        refuse_term_conflicts(spec_of("hold_obj_at_height_reward(red_cube, 0.3)\n"))
    assert "cannot both be met: 'red_cube' can be at one height only" in str(error.value)


def test_the_how_tos_term_is_printed_in_the_prompt_and_documented():
    text = render(
        "reward_program",
        {
            "objects": ("red_cube",),
            "joints": (),
            "calls": WITH_ONE_MORE.prompt_lines,
            "action": "hold the red cube up",
            "description": ("red_cube is at height 0.2",),
        },
    )
    assert "\nhold_obj_at_height_reward(obj, z)\n    holds an object at a height in metres\nexecute_plan" in text
    page = as_markdown(WITH_ONE_MORE)
    assert "| `hold_obj_at_height_reward(obj, z)` | holds the object at that height |" in page
    assert "- Arguments: `obj` an object; `z` the height from 0 to 1 m." in page


def test_the_how_tos_line_is_offered_read_and_served():
    assert "A is held at height Z     (Z in metres)" in offered_lines(True, False, WITH_ONE_MORE)
    assert parse_line("red_cube is held at height 0.2") is None
    line = parse_line("- red_cube is held at height 0.2 m.", WITH_ONE_MORE)
    assert line is not None and str(line) == "red_cube is held at height 0.2"
    assert reward_call(line) == "hold_obj_at_height_reward(red_cube, 0.2)"


@pytest.mark.parametrize(
    ("text", "kind", "value", "call"),
    [
        ("palm is close to crate", "close", None, "minimize_l2_distance_reward(palm, crate)"),
        ("1) a is far from b.", "far", None, "maximize_l2_distance_reward(a, b, distance=0.2)"),
        ("a is at height 0.25m", "height", 0.25, "set_obj_z_position_reward(a, 0.25)"),
        ("door is open", "open", None, "set_joint_fraction_reward(door, 1)"),
        ("door is 40% open", "open", 0.4, "set_joint_fraction_reward(door, 0.4)"),
        ("* door is closed", "closed", None, "set_joint_fraction_reward(door, 0)"),
    ],
)
def test_every_line_is_read_written_and_served_by_its_term(text, kind, value, call):
    line = parse_line(text)
    assert line is not None and (line.kind, line.value, reward_call(line)) == (kind, value, call)
    assert parse_line(str(line)) == line == line_of(kind, line.a, line.b, value)


def test_a_line_that_no_term_serves_lists_those_there_are():
    assert parse_line("a is close to") is None and parse_line("a is at height -1") is None
    with pytest.raises(
        ValueError, match=r"no reward term serves a line 'shut' with None; lines are \['close', 'closed'"
    ):
        line_of("shut", "door")


def test_a_motion_is_found_for_the_how_tos_term():
    plan = plan_motion(cubes(), spec_of(), SafetyLimits(), np.random.default_rng(0), kinematics=arm())
    assert isinstance(plan, MotionPlan)
    assert plan.end is not None
    twin = cubes()
    data = twin.start()
    data.qpos[:] = plan.end
    mujoco.mj_kinematics(twin.model, data)
    assert judge(spec_of().primary, float(posed_objects(twin, data)["red_cube"].position[2])).met


def test_a_spec_stays_data_whatever_vocabulary_its_terms_are_from():
    term = spec_of().primary
    assert {f.name for f in fields(term)} == {"kind", "subject", "target", "value", "primary"}
    assert replace(term, primary=False).definition is term.definition
    known = RewardTerm("set_joint_fraction", "door", None, 1.0)
    assert pickle.loads(pickle.dumps(known)) == known
    assert RewardTerm("set_joint_fraction", "door", None, 1.0, vocabulary=WITH_ONE_MORE) == known


def test_the_page_of_the_how_to_fits_on_a_screen():
    assert len(HOW_TO.read_text().splitlines()) <= 65


def test_the_documentation_shows_the_terms_that_exist():
    text = (ROOT / "docs" / "reward-terms.md").read_text()
    assert text.endswith(as_markdown(TERMS) + "\n"), "print it with `python -m control.tasks.documentation`"


def test_every_term_says_all_that_is_shown_of_it():
    for definition in TERMS.definitions:
        for text in (definition.prompt, definition.hand, definition.met, definition.cost, definition.conflicts):
            assert text and not text.endswith("."), definition.name
        assert definition.number is None or definition.number.least <= definition.number.low < definition.number.high


def test_no_term_reaches_a_safety_residual():
    assert not {row.name for row in safety_table()} & {*TERMS.names, *TERMS.calls}


def test_a_vocabulary_refuses_terms_that_specs_cannot_hold():
    kind = term_of_the_how_to()
    with pytest.raises(ValueError, match="two reward terms are named 'hold_obj_at_height'"):
        Vocabulary((kind(), kind()))
    three = type("Three", (kind,), {"names": (NameArgument("a", "object"),) * 3})
    with pytest.raises(ValueError, match="reward term 'hold_obj_at_height' has 3 names; specs hold one or two"):
        Vocabulary((three(),))
    odd = type("Odd", (kind,), {"name": "import os"})
    with pytest.raises(ValueError, match="'import os' is no name of a reward term"):
        Vocabulary((odd(),))


@pytest.mark.parametrize(
    ("term", "message"),
    [
        (("sing", "a"), "no reward term 'sing'; there are ['maximize_l2_distance'"),
        (("minimize_l2_distance", "a"), "minimize_l2_distance needs two names; it was given 'a' alone"),
        (("minimize_l2_distance", "a", "a"), "was given 'a' twice; name two different things"),
        (("minimize_l2_distance", "a", "b", 1.0), "minimize_l2_distance takes no number; it was given 1.0"),
        (("set_obj_z_position", "a", "b", 1.0), "takes one name; it was given 'a' and 'b'"),
        (("set_obj_z_position", "palm", None, 1.0), "needs the name of an object; 'palm' is none"),
        (("set_joint_fraction", "rest_position", None, 1.0), "needs the name of a joint; 'rest_position' is none"),
        (("set_joint_fraction", "door"), "set_joint_fraction of 'door' needs a number"),
        (
            ("maximize_l2_distance", "a", "b", -1.0),
            "the distance of maximize_l2_distance of 'a' must be a number from 0 to 10 m, not -1.0",
        ),
        (("set_joint_fraction", "door", None, math.nan), "must be a number from 0 to 1, not nan"),
        (("set_obj_orientation", "a", None, True), "must be a number from -6.28319 to 6.28319 rad, not True"),
    ],
)
def test_a_term_that_is_not_of_its_signature_says_what_it_takes(term, message):
    with pytest.raises(RewardSpecError) as error:
        RewardTerm(*term)
    assert message in str(error.value)


def test_names_are_looked_up_among_what_they_name():
    door = RewardTerm("set_joint_fraction", "door", None, 1.0, primary=True)
    cube = RewardTerm("minimize_l2_distance", "palm", "cube")
    spec = RewardSpec((cube, door))
    spec.check_names(frozenset({"cube"}), frozenset({"door"}))
    with pytest.raises(UnknownObjectError, match=r"no joint named 'door' in this scene; it has \['lid'\]"):
        spec.check_names(frozenset({"cube", "door"}), frozenset({"lid"}))
    with pytest.raises(UnknownObjectError, match=r"no object named 'cube' in this scene; it has \['jug'\]"):
        spec.check_names(frozenset({"jug"}), frozenset({"door"}))


def test_heights_of_many_rotations_are_those_of_each():
    rng = np.random.default_rng(0)
    turns = [rolled(np.eye(4), axis, angle)[:3, :3] for axis, angle in enumerate(rng.uniform(-3, 3, 3))]
    for shape in ("box", "cylinder", "sphere"):
        thing = PosedObject("thing", np.eye(4), np.array([0.05, 0.05, 0.12]), shape)
        many = half_heights(thing, np.array(turns)[None])
        for k, turn in enumerate(turns):
            pose = np.eye(4)
            pose[:3, :3] = turn
            assert many[0, k] == pytest.approx(replace(thing, pose=pose).half_height)


def test_a_turn_costs_less_the_nearer_it_is():
    twin = cubes()
    spec = RewardSpec((RewardTerm("set_obj_orientation", "red_cube", None, math.pi / 2, primary=True),))
    cost = RunningCost(
        twin, spec, read_subtask(spec), SafetyLimits(), arm(), palm_at(twin, twin.q), CostWeights(hold=0.0)
    )
    address = free_joint_address(twin.model, "red_cube")
    assert address is not None
    angles = np.linspace(0.0, math.pi / 2, 4)
    qpos = np.repeat(twin.qpos[None, None], len(angles), axis=0)
    qpos[:, 0, address + 3 : address + 7] = [[math.cos(a / 2), math.sin(a / 2), 0.0, 0.0] for a in angles]
    paid = cost.of(qpos, np.zeros((len(angles), 1, 7)), np.zeros((len(angles), 1), bool))
    assert np.all(np.diff(paid) < 0)
    term = spec.primary
    assert term.definition.turns_by(term) == pytest.approx(math.pi / 2)


def test_keeping_fixed_furniture_from_the_palm_is_costed():
    twin = cabinet()
    spec = RewardSpec((RewardTerm("maximize_l2_distance", "cabinet", "palm", 0.4, primary=True),))
    cost = RunningCost(twin, spec, read_subtask(spec), SafetyLimits(), arm(), palm_at(twin, twin.q), CostWeights())
    qpos = np.repeat(np.repeat(twin.qpos[None, None], 2, axis=0), 3, axis=1)
    paid = cost.of(qpos, np.zeros((2, 3, 7)), np.zeros((2, 3), bool))
    assert paid.shape == (2,) and np.all(np.isfinite(paid))
