"""Contact and collision levels: what the external torques mean under the thresholds that a client has set.

Above the lower threshold a joint or Cartesian direction counts as in contact, above the upper one as colliding. Which
pair holds depends on whether the set point accelerates. Source: libfranka, `robot.h`, setCollisionBehavior.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Mean |ddq_d| in [rad/s^2] from which on the thresholds for accelerating hold. Not published.
ACCELERATING = 0.05


@dataclass(frozen=True)
class Levels:
    """Thresholds of one phase: torques of the joints [Nm], shape (7,); force [N] and torque [Nm] at K, shape (6,)."""

    lower_torque: NDArray[np.float64]
    upper_torque: NDArray[np.float64]
    lower_force: NDArray[np.float64]
    upper_force: NDArray[np.float64]


@dataclass(frozen=True)
class BoxThresholds:
    """Thresholds while the set point accelerates, and otherwise."""

    accelerating: Levels
    nominal: Levels

    @classmethod
    def of(cls, numbers: np.ndarray) -> "BoxThresholds":
        """From a SetCollisionBehavior request: 4 x 7 torques, then 4 x 6 forces, shape (52,)."""
        torque, force = numbers[:28].reshape(4, 7), numbers[28:].reshape(4, 6)
        return cls(Levels(torque[0], torque[1], force[0], force[1]), Levels(torque[2], torque[3], force[2], force[3]))

    @classmethod
    def default(cls) -> "BoxThresholds":
        """Before a client has set any: those of libfranka's `examples_common.cpp`, setDefaultBehavior."""
        high = Levels(np.full(7, 20.0), np.full(7, 20.0), np.full(6, 20.0), np.full(6, 20.0))
        low = Levels(np.full(7, 10.0), np.full(7, 10.0), np.full(6, 10.0), np.full(6, 10.0))
        return cls(high, low)

    def at(self, ddq_d: np.ndarray) -> Levels:
        """Those that hold while the set point has this acceleration in [rad/s^2], shape (7,)."""
        return self.accelerating if np.abs(ddq_d).mean() > ACCELERATING else self.nominal
