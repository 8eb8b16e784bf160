"""Stepping many simulations together, each from its own state: the one place where a planner's steps are spent.

Whoever measures a planner passes an observer, which is told of each batch before it is simulated and can play exactly
the same again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import batch as mjbatch
from numpy.typing import NDArray


@dataclass(frozen=True)
class SimulatedBatch:
    """What `mujoco.batch` needs to simulate some motions.

    Attributes:
        models: One model per simulation, all of the same layout; often the same one.
        qpos: Configurations at the start, shape (n, nq).
        qvel: Velocities at the start, shape (n, nv).
        warmstart: Accelerations from which the constraint solver starts, shape (n, nv).
        controls: Servo targets before each step, shape (n, steps, nu).
        nthread: Threads; results do not depend on it.
    """

    models: tuple[mujoco.MjModel, ...]
    qpos: NDArray[np.float64]
    qvel: NDArray[np.float64]
    warmstart: NDArray[np.float64]
    controls: NDArray[np.float64]
    nthread: int

    @property
    def steps(self) -> int:
        """Simulated steps (mj_step) of all motions together."""
        return self.controls.shape[0] * self.controls.shape[1]


Observer = Callable[[SimulatedBatch], None]


def simulate(batch: SimulatedBatch, record: Sequence[str], observe: Observer | None = None) -> dict[str, np.ndarray]:
    """Simulate all motions of a batch to their end.

    Args:
        batch: Models, start states and servo targets.
        record: Fields of `mujoco.MjData` to return.
        observe: Told of the batch first.

    Returns:
        For each field its value after each step, shape (n, steps, ...).
    """
    if observe is not None:
        observe(batch)
    first = batch.models[0]
    sims = mjbatch.Batch(first, len(batch.models), batch.nthread)
    if any(model is not first for model in batch.models):
        sims.set_models(list(batch.models))
    sims.bind("qpos")[:] = batch.qpos
    sims.bind("qvel")[:] = batch.qvel
    sims.bind("qacc_warmstart")[:] = batch.warmstart
    recorded = sims.rollout(batch.controls.shape[1], batch.controls, record=tuple(record))
    return {name: recorded[name] for name in record}
