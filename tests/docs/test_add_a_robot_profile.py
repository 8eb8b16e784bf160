"""docs/how-to/add-a-robot-profile.md: its profile is read, named by a cell file, and held to by retiming and checks."""

import numpy as np
import pytest
import yaml

from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.limits import REST_Q, RobotLimits, panda_limits
from control.robot.profiles import FOLDER
from control.safety.trajectory_checks import check_trajectory
from control.trajectory.samples import JointPath, PathSegment
from sim_check.cells.loading import CellConfig, load_cell
from tests.support.documents import ROOT, blocks

PROFILE, ROBOT = blocks(ROOT / "docs" / "how-to" / "add-a-robot-profile.md", "yaml")


@pytest.fixture
def cell(tmp_path) -> CellConfig:
    """The built-in cell with the page's two lines in place of its robot."""
    (tmp_path / "panda-with-cable.yaml").write_text(PROFILE)
    content = yaml.safe_load((ROOT / "sim_check" / "cells" / "builtin" / "cubes.yaml").read_text())
    (tmp_path / "my-bench.yaml").write_text(yaml.safe_dump(content | yaml.safe_load(ROBOT)))
    return load_cell(tmp_path / "my-bench.yaml")


@pytest.fixture
def limits(cell) -> RobotLimits:
    return cell.robot.limits()


def test_the_cell_has_the_limits_of_the_page(limits):
    assert limits.profile == "panda_with_cable/1"
    assert limits.q_max[6] == 1.5 and limits.qd[0] == 1.0


def test_it_says_everything_that_the_copied_file_says():
    copied = yaml.safe_load((FOLDER / "panda-5.yaml").read_text())
    assert set(yaml.safe_load(PROFILE)) == set(copied)


def test_a_motion_keeps_to_it_and_a_motion_for_the_panda_does_not(cell, limits):
    robot, safety = RobotModel.panda(), cell.safety_limits()
    start = np.array(REST_Q)
    way = np.zeros(7)
    way[6] = 0.6
    path = JointPath((PathSegment("turn", np.linspace(start, start + way, 30)),))
    slow, fast = (retime(path, robot, within, safety) for within in (limits, panda_limits()))
    assert not [c.name for c in check_trajectory(slow, limits, safety, robot.torque, robot.tcp_poses) if not c.ok]
    broken = {c.name for c in check_trajectory(fast, limits, safety) if not c.ok}
    assert "joint_acceleration" in broken
    assert slow.duration > fast.duration
