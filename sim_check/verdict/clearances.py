"""How near things come along a replayed motion, held against the safety table without any planning margin."""

from dataclasses import dataclass

import mujoco
import numpy as np

from control.path_planning.collision_filter import PARTS, CollisionFilter, Phase
from control.safety.limits import SafetyLimits
from control.safety.residuals import Clearances
from control.simulation.motion_recording import Purpose
from control.simulation.rollouts import Rollout
from control.trajectory.samples import Trajectory
from control.twin_model import TwinModel

REACH = 0.05  # [m] up to which distances are told for a picture; clearances are smaller


@dataclass(frozen=True)
class Near:
    """How near one part of the robot, or what it holds, comes to anything else.

    Attributes:
        lack: Largest clearance that is asked for minus distance in [m]; -inf where nothing is near.
        lacking: The two bodies that lack it, the one outside last; or none.
        distance: Least distance in [m], negative in overlap; inf where nothing is within reach.
        nearest: The two bodies at that distance.
    """

    lack: float = -np.inf
    lacking: tuple[str, ...] = ()
    distance: float = np.inf
    nearest: tuple[str, ...] = ()


class ClearanceMeter:
    """Measures whole configurations in one phase.

    Args:
        look: Who has to keep which distance from whom.
        phase: What the hand is doing.
        reach: Distance in [m] up to which things are looked for that are farther than their clearance.
    """

    def __init__(self, look: CollisionFilter, phase: Phase, reach: float = 0.0) -> None:
        self._look, self._pairs, self._reach = look, look.pairs(phase), reach
        self._part = [look.part(a, b) for a, b in self._pairs.pair]
        self._limit = self._pairs.limit.tolist()
        # mj_geomDistance tells nothing beyond its last argument.
        self._until = np.maximum(np.maximum(self._pairs.limit, 0.0) + 0.001, reach).tolist()
        self._data, self._segment = mujoco.MjData(look.model), np.zeros(6)
        self._names: dict[int, tuple[str, ...]] = {}

    def at(self, qpos: np.ndarray) -> dict[str, Near]:
        """For each of `PARTS` how near it comes in a configuration of the twin's model, shape (nq,)."""
        model, data = self._look.model, self._data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        lack, lacking = dict.fromkeys(PARTS, -np.inf), dict.fromkeys(PARTS, -1)
        distance, nearest = dict.fromkeys(PARTS, np.inf), dict.fromkeys(PARTS, -1)
        for i in self._pairs.near(data, prune=True, reach=self._reach).tolist():
            part = self._part[i]
            if part is None:
                continue
            a, b = self._pairs.pair[i]
            apart = mujoco.mj_geomDistance(model, data, a, b, self._until[i], self._segment)
            if apart >= self._until[i]:
                continue
            if self._limit[i] - apart > lack[part]:
                lack[part], lacking[part] = self._limit[i] - apart, i
            if apart < distance[part]:
                distance[part], nearest[part] = apart, i
        return {p: Near(lack[p], self._bodies(lacking[p]), distance[p], self._bodies(nearest[p])) for p in PARTS}

    def _bodies(self, i: int) -> tuple[str, ...]:
        if i < 0:
            return ()
        if i not in self._names:  # the same few pairs are nearest most of the time
            self._names[i] = self._look.bodies(*self._pairs.pair[i])
        return self._names[i]


def measure_clearances(
    rollout: Rollout,
    times: np.ndarray,
    twin: TwinModel,
    purpose: Purpose,
    safety: SafetyLimits,
    phase_when_free: Phase = Phase.CARRY,
    stride: int = 2,
) -> Clearances:
    """Least distances along a rollout.

    Args:
        rollout: One simulated motion.
        times: Times of the recorded motion's samples in [s], shape (n,): the samples that are referred to.
        twin: Where it went.
        purpose: Who may be handled, and what may carry it.
        safety: The clearances.
        phase_when_free: How a held object is judged that moves freely: `Phase.CARRY` keeps it away from everything,
            `Phase.CONTACT` lets it touch what may carry it.
        stride: Look at every `stride`-th of the samples.
    """
    default = purpose.subject or twin.held
    looks: dict[str | None, dict[bool, ClearanceMeter]] = {}
    for name in {default, *(span.name for span in rollout.commands.handled)}:
        allowed = (purpose.supports | purpose.named) - {name}
        # Where nobody says what the fingers are at, they may be at anything that is handled.
        others = purpose.handled if name == default else ()
        grasping = CollisionFilter(twin, safety, name, allowed, margin=0.0, others=others)
        carrying = CollisionFilter(twin, safety, name, allowed, margin=0.0)
        looks[name] = {
            False: ClearanceMeter(grasping, Phase.GRASP, REACH),
            True: ClearanceMeter(carrying, phase_when_free, REACH),
        }
    dt = float(rollout.time[1] - rollout.time[0])
    steps = np.arange(0, len(times), stride)
    lack = {name: np.full(len(steps), -np.inf) for name in PARTS}
    distance = {name: np.full(len(steps), np.inf) for name in PARTS}
    bodies = {name: [""] * len(steps) for name in PARTS}
    nearest = {name: [""] * len(steps) for name in PARTS}
    for k, step in enumerate(steps):
        row = min(round(times[step] / dt), len(rollout.qpos) - 1)
        free = any(start <= row < stop for start, stop in rollout.commands.free)
        at = (span.name for span in rollout.commands.handled if span.start <= row < span.stop)
        for name, near in looks[next(at, default)][free].at(rollout.qpos[row]).items():
            if name == "held" and not free:
                continue
            lack[name][k], distance[name][k] = near.lack, near.distance
            bodies[name][k] = near.lacking[-1] if near.lacking else ""
            nearest[name][k] = near.nearest[-1] if near.nearest else ""
    return Clearances(
        steps, lack, {n: tuple(b) for n, b in bodies.items()}, distance, {n: tuple(b) for n, b in nearest.items()}
    )


def phase_when_free(trajectory: Trajectory) -> Phase:
    """How a held object is judged in transit: strictly where the trajectory says when it may touch what carries it.

    A trajectory that only says what is held does not tell lifting and lowering from carrying.
    """
    return Phase.CARRY if any(s.touching for s in trajectory.segments) else Phase.CONTACT
