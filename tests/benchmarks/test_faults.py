"""Whatever fails in a motion of the real driver: nothing moves that should not, and nothing is lost.

One injection of each kind of fault; `replan bench faults` does hundreds, with random moments and motions.
"""

from collections.abc import Iterator

import numpy as np
import pytest

from benchmarks.robot_side.fault_judgement import judge_movement
from benchmarks.robot_side.fault_kinds import KINDS, Kind
from benchmarks.robot_side.faults import Rig, inject, summary
from benchmarks.robot_side.panda_side import History
from benchmarks.robot_side.perfect_robot import swing

pytest.importorskip("panda_py", reason="the driver speaks through libfranka")
# Others have tests of their own that go further: tests/hw_interface/panda/test_driver.py,
# tests/hw_interface/link/test_faulty_links.py.
HERE = (
    "player killed",
    "supervisor frozen",
    "planner killed",
    "planner frozen",
    "gripper process killed",
    "gripper not answering",
    "control box frozen",
    "few packets lost",
    "many packets lost",
    "link 200 ms late",
    "link parted for 2 s",
    "duplicated trajectory",
    "no certificate",
    "clock an hour ahead",
    "flipped bits",
    "other version",
    "disk full",
)

pytestmark = pytest.mark.real_time


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    running = Rig(tmp_path_factory.mktemp("rig"))
    yield running
    running.close()


@pytest.mark.parametrize("kind", [k for k in KINDS if k.name in HERE], ids=lambda k: k.name)
def test_nothing_moves_that_should_not(rig: Rig, kind: Kind):
    for seed in (1000, 1001):
        done = inject(rig, kind, seed)
        assert (done.uncertified, done.false_done, done.log_readable) == (0, False, True), done
        if not done.note:
            break  # else the motion was over before the fault could be injected
    assert not done.note, done
    assert done.outcome in kind.expected, done
    if kind.loses_supervisor:
        assert done.to_rest is not None and done.to_rest <= 0.5 and done.departure <= 1e-3, done
    if "refused" in kind.expected:
        assert done.refused, done


def test_every_fault_that_is_tested_exists():
    assert set(HERE) <= {k.name for k in KINDS}


def history(q_d: np.ndarray, mode: int) -> History:
    return History(np.arange(len(q_d)), np.full(len(q_d), mode, np.uint8), q_d, q_d, np.ones(len(q_d), bool))


def test_the_judge_sees_motion_beside_the_certified_path():
    motion = swing(1.0, 0.3)
    still = np.repeat(motion.q[-1:], 200, axis=0)
    good = judge_movement(history(np.concatenate([motion.q, still]), 2), 0, 500, motion)
    assert good.uncertified == 0 and good.to_rest == pytest.approx(0.5, abs=0.01)
    beside = motion.q + np.linspace(0.0, 2e-3, len(motion.q))[:, None]
    bad = judge_movement(history(np.concatenate([beside, np.repeat(beside[-1:], 200, axis=0)]), 2), 0, 500, motion)
    assert bad.uncertified > 100 and bad.departure == pytest.approx(2e-3, rel=0.05)
    blow = history(np.concatenate([motion.q[:501], np.repeat(motion.q[500:501] + 1e-3, 200, axis=0)]), 2)
    assert judge_movement(blow, 0, 400, motion).uncertified == 1, "a client that commands this is seen"
    blow.told[501:] = False
    assert judge_movement(blow, 0, 400, motion).uncertified == 0, "the box that gives way to a blow is no client"
    moving = judge_movement(history(motion.q[:500], 2), 0, 100, motion)
    assert moving.to_rest is None, "it does not rest at the end of the window"


def test_a_summary_counts_what_must_not_be():
    from benchmarks.robot_side.faults import Injection

    wrong = Injection("push", 0, "rests", "completed", False, 3, 0.1, 0.2, True, False)
    lost = Injection("supervisor killed", 0, "rests", "RobotGoneError", True, 0, 2e-9, 0.31, False, True)
    figures = summary([wrong, lost])
    assert (figures["uncertified_motions"], figures["false_done"], figures["unreadable_logs"]) == (1, 1, 1)
    assert figures["loss_of_supervisor"]["to_rest_s_max"] == 0.31
