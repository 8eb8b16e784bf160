"""Motion planners by name: whatever finds a motion for one subtask in the twin, behind one interface.

candidates            structured candidates, filtered by geometry, simulated from start to end
predictive-sampling   the baseline: noisy joint splines, simulated and followed for a short time, again and again
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np

from control.errors import ConfigError
from control.planners.motion_search import plan_motion
from control.planners.predictive_sampling import plan_by_sampling
from control.planners.result import MotionPlan
from control.robot.kinematics import ArmKinematics
from control.safety.limits import SafetyLimits
from control.simulation.batches import Observer
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec
from control.twin_model import TwinModel


class Planner(Protocol):
    """Finds a motion that meets a spec's primary term in the twin, or says why there is none.

    The same state of `rng` gives the same result at any number of threads. What a plan returns has met the term in
    the twin; whether a robot may play it is for the verdict on the retimed path.
    """

    def __call__(
        self,
        twin: TwinModel,
        spec: RewardSpec,
        safety: SafetyLimits,
        rng: np.random.Generator,
        kinematics: ArmKinematics | None = None,
        *,
        nthread: int = 2,
        observe: Observer | None = None,
    ) -> MotionPlan | FailureCause:
        """Plan one subtask; `observe` is told of each batch of motions that is simulated."""
        ...


PLANNERS: Mapping[str, Planner] = MappingProxyType({"candidates": plan_motion, "predictive-sampling": plan_by_sampling})


def planner_named(name: str) -> Planner:
    """The planner of a name.

    Raises:
        ConfigError: There is none; lists those there are.
    """
    if name not in PLANNERS:
        raise ConfigError(f"no motion planner named '{name}'; there are {sorted(PLANNERS)}")
    return PLANNERS[name]
