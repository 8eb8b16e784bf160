"""The safety table lists what is judged, all of it, with the limits that are used; each row has its test."""

from dataclasses import replace
from pathlib import Path

import pytest

from control.robot.limits import panda_limits
from control.safety.limits import SafetyLimits
from control.safety.residuals import safety_residuals
from control.safety.table import STAGES, as_markdown, safety_table
from tests.control.safety.test_residuals import CASES
from tests.control.safety.test_trajectory_checks import ALONE
from tests.sim_check.test_verdict import judge, placing, red_on_crate

ROWS = {row.name: row for row in safety_table()}
# Judged by the verdict from the whole motion; tests/sim_check/test_verdict.py breaks each of them alone.
OF_THE_VERDICT = {"start_state", "reward_met"}
# tests/control/safety/test_swept_volume.py breaks each of them alone.
OF_LOOKS = {name for name, row in ROWS.items() if row.stage == "looks"}
# A blow on the arm is an unwanted contact as well; tests/control/safety/test_residuals.py breaks both and nothing else.
IMPLIED = {"contact_force"}


def test_every_row_has_a_motion_in_the_tests_that_breaks_it_alone():
    assert len(ROWS) == len(safety_table())
    assert set(CASES) | set(ALONE) | OF_THE_VERDICT | OF_LOOKS | IMPLIED == set(ROWS)


def test_a_verdict_holds_a_motion_against_exactly_these_rows_and_limits():
    checks = judge(placing(), red_on_crate()).checks
    # No camera looks at the twins of these tests.
    assert [c.name for c in checks] == [name for name in ROWS if name not in OF_LOOKS]
    for check in checks:
        row = ROWS[check.name]
        if check.name not in ("starts_at_rest", "ends_at_rest"):  # these report speed or acceleration
            assert check.unit == row.unit
            assert any(check.limit == pytest.approx(x) for x in row.limit), check.name


def test_a_cells_own_numbers_are_the_tables():
    safety = replace(SafetyLimits(), hand_speed=0.3, contact_force=9.0, velocity_scale=0.5, arm_clearance=0.02)
    rows = {row.name: row for row in safety_table(safety)}
    assert rows["hand_speed"].limit == (0.3,) and rows["contact_force"].limit == (9.0,)
    assert rows["tracked_hand_speed"].limit == pytest.approx((0.36,))
    assert rows["joint_velocity"].limit == pytest.approx(tuple(panda_limits().qd * 0.5))
    assert "20 mm are asked for" in rows["arm_clearance"].meaning
    assert rows["joint_position"].least and not rows["torque"].least


def test_every_row_says_who_judges_it_and_what_it_is():
    assert {row.stage for row in ROWS.values()} == set(STAGES)
    assert all(row.meaning and row.unit for row in ROWS.values())
    assert {r.name for r in safety_residuals(SafetyLimits())} <= set(ROWS)


def test_the_documentation_shows_this_table():
    text = (Path(__file__).resolve().parents[3] / "docs" / "safety.md").read_text()
    assert as_markdown(safety_table()) in text, "print it with `python -m control.safety.table`"
