"""A motion is followed from stop to stop: where the twin departs from it, the rest is planned anew from there."""

import copy
from dataclasses import replace

import mujoco
import numpy as np

from benchmarks.scenes.furniture_twins import cabinet, lever
from benchmarks.scenes.tabletop_twins import arm, cubes, only, red_on_crate
from control.path_planning.planning_context import PlanningContext
from control.planners.candidate_search import Search
from control.planners.candidates import candidates
from control.planners.motion_search import plan_motion
from control.planners.receding_horizon import first_departure, follow
from control.planners.result import MotionPlan
from control.robot.limits import panda_limits
from control.safety.limits import SafetyLimits
from control.tasks.reward_spec import RewardSpec
from control.tasks.subtasks import read_subtask
from control.twin_model import TwinModel

SAFETY = SafetyLimits()
PULL = only("set_joint_fraction", "lever_rod", value=1.0)


def searched(twin: TwinModel, spec: RewardSpec) -> Search:
    """A search that has simulated its first candidates."""
    context = PlanningContext(
        twin, read_subtask(spec), SAFETY, panda_limits(), arm(), np.random.default_rng(0), spec=spec
    )
    search = Search(context, spec, candidates(context), 24, nthread=1)
    search.try_until()
    return search


def stiff(twin: TwinModel, joint: str, factor: float) -> TwinModel:
    """The twin with more dry friction and damping in a joint: its handle rolls between the pads and it lags behind."""
    model = copy.copy(twin.model)
    dof = int(model.joint(joint).dofadr[0])
    model.dof_frictionloss[dof] *= factor
    model.dof_damping[dof] *= factor
    return replace(twin, model=model)


def slippery(twin: TwinModel, name: str, friction: float, heavier: float) -> TwinModel:
    """The twin with smooth pads and a heavy object."""
    model = copy.copy(twin.model)
    for pad in ("left_pad", "right_pad"):
        model.geom_friction[model.geom(pad).id] *= friction
    body = model.body(name).id
    model.body_mass[body] *= heavier
    model.body_inertia[body] *= heavier
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return replace(twin, model=model)


def test_a_motion_that_goes_as_predicted_is_left_as_it_is_and_costs_nothing():
    search = searched(cubes(), red_on_crate())
    best, steps = search.ranked()[0], search.steps
    assert first_departure(search.context, best) is None
    assert follow(search, best) is best and search.steps == steps


def test_a_joint_that_lags_behind_is_taken_on_from_where_it_stands():
    search = searched(stiff(lever(), "lever_rod", 60.0), PULL)
    best = search.ranked()[0]
    departure = first_departure(search.context, best)
    assert departure is not None and departure.at_handle
    assert departure.text.startswith("lever_rod is 9") and departure.text.endswith("open, not 101%")
    followed = follow(search, best)
    assert followed is not best and followed.good
    drives = [s for s in followed.candidate.segments if s.name == "drive"]
    assert len(drives) == 2 and drives[0].gripper is None and drives[1].gripper is not None
    assert np.allclose(drives[1].q[0], drives[0].q[-1])
    ends = [search.context.twin.joint_fractions(t.rollout.end)["lever_rod"] for t in (best, followed)]
    assert abs(ends[1] - 1.0) < abs(ends[0] - 1.0)


def test_a_door_that_is_lost_on_the_way_is_taken_again_from_where_it_stands():
    twin = stiff(cabinet(), "cabinet_left_door", 8.0)
    search = searched(twin, only("set_joint_fraction", "cabinet_left_door", value=0.8))
    best = search.ranked()[0]
    departure = first_departure(search.context, best)
    assert not best.good and departure is not None and not departure.at_handle
    followed = follow(search, best)
    ends = [twin.joint_fractions(t.rollout.end)["cabinet_left_door"] for t in (best, followed)]
    assert ends[1] > ends[0] + 0.1
    assert search.context.counts["replanned"] > 0


def test_an_object_that_slips_in_the_hand_is_noticed_where_the_arm_next_rests():
    search = searched(slippery(cubes(), "red_cube", 0.05, 4.0), red_on_crate())
    departures = [d for t in search.tried if (d := first_departure(search.context, t)) is not None]
    assert departures
    assert all("red_cube" in d.text for d in departures)


def test_following_is_the_same_at_any_number_of_threads():
    twin = stiff(lever(), "lever_rod", 12.0)
    plans = [plan_motion(twin, PULL, SAFETY, np.random.default_rng(3), kinematics=arm(), nthread=n) for n in (1, 2)]
    assert all(isinstance(p, MotionPlan) for p in plans)
    first, second = (np.vstack([s.q for s in p.path.segments]) for p in plans if isinstance(p, MotionPlan))
    assert np.array_equal(first, second)
