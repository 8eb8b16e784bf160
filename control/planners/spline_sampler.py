"""Predictive sampling: noisy copies of a nominal spline are simulated, the cheapest is followed for one period.

Shifted in time, the cheapest becomes the next nominal. Source: Howell et al., "Predictive Sampling: Real-time
Behaviour Synthesis with MuJoCo", 2022, algorithm 1. Splines are joint positions for the arm's servos; fingers are open
or closed from one point to the next.
"""

from dataclasses import dataclass, field

import numpy as np

from control.errors import ConfigError
from control.planners.sampling_cost import CostWeights, RunningCost
from control.planners.splines import SplineBasis, SplineOrder
from control.robot.limits import panda_limits
from control.simulation.closed_loop import ClosedLoop
from control.simulation.rollouts import Commands, controls_for
from control.twin_model import TwinModel

LIMIT_MARGIN = 0.05  # [rad] kept from joint limits, as by the other planner


@dataclass(frozen=True)
class SamplingSettings:
    """Settings of predictive sampling.

    Defaults follow MuJoCo MPC and RePlan's use of it (60 trajectories, horizon 0.5 to 0.6 s, 5 to 7 cubic spline
    points, smooth L2 norms with p = 0.01, give up after 7.5 s) where not said otherwise.

    Attributes:
        trajectories: Splines that are simulated at each re-plan, the nominal one included.
        horizon: Time that they look ahead in [s].
        points: Spline points, the first of which is where the arm is told to be now.
        order: "cubic" or "linear".
        noise: Standard deviation of the noise on each point and joint in [rad]. RePlan has 0.04 to 0.1 and re-plans
            every 15 ms; with fewer re-plans each has to reach further: with 0.1 rad a door was not opened in time.
        fine_share, fine_noise: Share of samples whose noise is multiplied by `fine_noise`, so that large motions and
            exact ones are both among the samples.
        switch_share: Share of samples that open or close the fingers from one of their points on.
        period: Time from one re-plan to the next in [s]. MuJoCo MPC re-plans as fast as it can, in some 10 ms; here
            simulated steps are what counts, and a multiple of that costs little.
        speed_share: Share of the joint speed limits that splines may ask for.
        time_limit: Simulated time of the motion after which it is given up, in [s].
        cost_period: Time between states that are costed in [s].
        weights: Of the parts of the cost.

    Raises:
        ConfigError: No trajectory, fewer than two points, or a period that is not within the horizon.
    """

    trajectories: int = 60
    horizon: float = 0.6
    points: int = 6
    order: SplineOrder = "cubic"
    noise: float = 0.2
    fine_share: float = 0.5
    fine_noise: float = 0.2
    switch_share: float = 0.2
    period: float = 0.1
    speed_share: float = 0.6
    time_limit: float = 7.5
    cost_period: float = 0.02
    weights: CostWeights = field(default_factory=CostWeights)

    def __post_init__(self) -> None:
        if self.trajectories < 1 or self.points < 2:
            raise ConfigError(
                f"predictive sampling with {self.trajectories} trajectories of {self.points} spline points; it needs "
                "at least one trajectory and two points"
            )
        if not 0.0 < self.period <= self.horizon:
            raise ConfigError(
                f"predictive sampling that re-plans every {self.period} s; the period must be above 0 and at most the "
                f"horizon of {self.horizon} s"
            )


class SplineSampler:
    """The nominal spline and how it is improved."""

    def __init__(self, twin: TwinModel, cost: RunningCost, settings: SamplingSettings) -> None:
        self._twin, self._cost, self._settings = twin, cost, settings
        s, dt = settings, float(twin.model.opt.timestep)
        self._steps = round(s.horizon / dt)
        self._every = max(1, round(s.cost_period / dt))
        self._period = round(s.period / dt)
        self._basis = SplineBasis.of(s.order, s.points, s.horizon, np.arange(1, self._steps + 1) * dt)
        knots = np.linspace(0.0, s.horizon, s.points)
        self._shift = SplineBasis.of(s.order, s.points, s.horizon, knots + self._period * dt)
        begins = np.round(knots / dt).astype(int)
        self._counts = np.diff(begins)  # steps from each point to the next
        # Which stretch each stretch begins in after one period.
        self._later = np.minimum(np.searchsorted(begins, begins[:-1] + self._period, "right") - 1, s.points - 2)
        self._limits = panda_limits()
        # An arm that starts nearer to a limit may stay there, but goes no further.
        self._low = np.minimum(self._limits.q_min + LIMIT_MARGIN, twin.q)
        self._high = np.maximum(self._limits.q_max - LIMIT_MARGIN, twin.q)
        self._nominal = np.tile(np.array(twin.q, float), (s.points, 1))
        self._closed = np.zeros(s.points - 1, bool)  # fingers of the nominal from each point to the next
        self._until = -1.0  # time at which the nominal begins
        self.replans = 0
        self.cost = np.inf

    def follow_best(self, loop: ClosedLoop, rng: np.random.Generator) -> None:
        """Re-plan once and execute the first period of the best sample."""
        if loop.time != self._until:  # the start, or the motion rested: the nominal is to stay there
            self._nominal = np.tile(loop.command, (self._settings.points, 1))
            self._closed = np.full(self._settings.points - 1, loop.closed)
        n = self._settings.trajectories
        points = self._sample_points(loop, rng)
        closed = self._sample_fingers(loop, rng)
        arm, speed = self._basis.sample(points, loop.speed)
        arm = np.clip(arm, self._low, self._high)
        fingers = loop.finger_targets(closed, self._counts)
        flat = Commands(arm.reshape(-1, 7), speed.reshape(-1, 7), fingers.ravel(), ())
        controls = controls_for(self._twin.model, flat).reshape(n, self._steps, -1)
        qpos = loop.simulate(controls, ("qpos",))["qpos"]
        rows = slice(self._every - 1, None, self._every)
        shut = np.repeat(closed, self._counts, axis=1)
        costs = self._cost.of(qpos[:, rows], speed[:, rows], shut[:, rows])
        best = int(np.argmin(costs))
        self.cost = float(costs[best])
        self.replans += 1
        self._nominal, _ = self._shift.sample(points[best], loop.speed)
        self._closed = closed[best, self._later]
        p = self._period
        loop.run(Commands(arm[best, :p], speed[best, :p], fingers[best, :p], ()), shut[best, :p])
        self._until = loop.time

    def _sample_points(self, loop: ClosedLoop, rng: np.random.Generator) -> np.ndarray:
        """Spline points in [rad], shape (n, points, 7); the first sample is the nominal one."""
        s = self._settings
        fine = rng.random(s.trajectories) < s.fine_share
        scale = np.where(fine, s.fine_noise, 1.0) * s.noise
        scale[0] = 0.0
        points = self._nominal + rng.standard_normal((s.trajectories, s.points, 7)) * scale[:, None, None]
        points[:, 0] = loop.command
        reach = self._limits.qd * s.speed_share * s.horizon / (s.points - 1)
        for k in range(1, s.points):
            points[:, k] = np.clip(points[:, k], points[:, k - 1] - reach, points[:, k - 1] + reach)
        return np.clip(points, self._low, self._high)

    def _sample_fingers(self, loop: ClosedLoop, rng: np.random.Generator) -> np.ndarray:
        """Whether fingers are told to be closed from each point to the next, shape (n, points - 1)."""
        s = self._settings
        closed = np.tile(self._closed, (s.trajectories, 1))
        switches = rng.random(s.trajectories) < s.switch_share
        since = rng.integers(0, s.points - 1, s.trajectories)
        if loop.task.subject is None:  # nothing to take hold of
            return closed
        for i in np.flatnonzero(switches[1:]) + 1:
            closed[i, since[i] :] = not closed[i, since[i]]
        return closed
