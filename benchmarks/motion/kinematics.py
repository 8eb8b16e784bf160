"""What the arm's batched kinematics save against a rigid-body library that is called row by row.

    jacobian    tool poses and Jacobians of random configurations: one call of numpy for all, or Pinocchio for each
    inverse     the same damped least-squares steps, from random configurations to random poses: all rows together, or
                row by row with Pinocchio's frames and Jacobians

Both sides are checked to agree, and take turns. Times are processor times a row, for `inverse` a row and a step.

    python -m benchmarks.motion.kinematics [--repeats 9] [--json]
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pinocchio  # pyright: ignore[reportMissingImports] -- its path is added by a .pth file

from control.robot.description import TCP_FRAME, arm_model
from control.robot.gripper import PANDA_HAND
from control.robot.kinematics import ArmKinematics
from control.robot.rotations import rotation_log

ROWS = (10, 100, 1000, 10_000)  # a pose from ten seeds; up to all grasps of an object at once
STEPS = 10
DAMPING = 0.02


@dataclass(frozen=True)
class Row:
    """One comparison, in [us] a row (and step).

    Attributes:
        what, rows: What was done, for how many configurations.
        batched, one_by_one: Medians.
    """

    what: str
    rows: int
    batched: float
    one_by_one: float


class OneByOne:
    """The tool's pose and Jacobian by Pinocchio, for one configuration after the other."""

    def __init__(self) -> None:
        self._model = arm_model(PANDA_HAND, PANDA_HAND.opening)
        self._data = self._model.createData()
        self._frame = self._model.getFrameId(TCP_FRAME)
        self._rest = np.zeros(self._model.nq - 7)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian in base axes, shape (7,) → (6, 7); the pose is left in the library's data."""
        full = np.concatenate([q, self._rest]) if len(self._rest) else q
        pinocchio.computeJointJacobians(self._model, self._data, full)
        pinocchio.updateFramePlacement(self._model, self._data, self._frame)
        axes = pinocchio.LOCAL_WORLD_ALIGNED
        return pinocchio.getFrameJacobian(self._model, self._data, self._frame, axes)[:, :7]

    def jacobians(self, q: np.ndarray) -> np.ndarray:
        """Shape (n, 7) → (n, 6, 7)."""
        return np.array([self.jacobian(row) for row in q])

    def inverse(self, q: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """Steps of each row towards its own pose; shapes (n, 7), (n, 4, 4) → (n, 7)."""
        found = []
        for now, target in zip(q, targets, strict=True):
            for _ in range(STEPS):
                jacobian = self.jacobian(now)
                pose = self._data.oMf[self._frame]
                turned = pinocchio.log3(target[:3, :3] @ pose.rotation.T)
                error = np.concatenate([target[:3, 3] - pose.translation, turned])
                normal = jacobian @ jacobian.T + DAMPING**2 * np.eye(6)
                now = now + jacobian.T @ np.linalg.solve(normal, error)
            found.append(now)
        return np.array(found)


def batched_inverse(arm: ArmKinematics, q: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """As `OneByOne.inverse`, all rows together."""
    for _ in range(STEPS):
        position, rotation, jacobian = arm.jacobian(q)
        turned = rotation_log(targets[:, :3, :3] @ rotation.transpose(0, 2, 1))
        error = np.concatenate([targets[:, :3, 3] - position, turned], axis=1)
        normal = jacobian @ jacobian.transpose(0, 2, 1) + DAMPING**2 * np.eye(6)
        q = q + (jacobian.transpose(0, 2, 1) @ np.linalg.solve(normal, error[:, :, None]))[:, :, 0]
    return q


def measure(repeats: int, counts: Sequence[int] = ROWS) -> list[Row]:
    """Measure everything.

    Args:
        repeats: Of each measurement.
        counts: Numbers of rows.

    Raises:
        ValueError: The two sides disagree.
    """
    arm, library, draw = ArmKinematics.from_urdf(), OneByOne(), np.random.default_rng(0)
    rows = []
    for count in counts:
        middle, half = (arm.q_min + arm.q_max) / 2, (arm.q_max - arm.q_min) / 2
        goal = middle + 0.7 * half * draw.uniform(-1.0, 1.0, (count, 7))
        q, targets = goal + draw.uniform(-0.3, 0.3, (count, 7)), arm.poses(goal)
        pairs: dict[str, tuple[Callable[[], np.ndarray], Callable[[], np.ndarray], int]] = {
            "jacobian": (lambda q=q: arm.jacobian(q)[2], lambda q=q: library.jacobians(q), 1),
            "inverse": (
                lambda q=q, t=targets: batched_inverse(arm, q, t),
                lambda q=q, t=targets: library.inverse(q, t),
                STEPS,
            ),
        }
        for what, (batched, one_by_one, steps) in pairs.items():
            if np.abs(batched() - one_by_one()).max() > 1e-6:
                raise ValueError(f"the two sides disagree about '{what}' of {count} rows")
            took = np.array([[_seconds(batched), _seconds(one_by_one)] for _ in range(repeats)])
            each = 1e6 * np.median(took, axis=0) / (count * steps)
            rows.append(Row(what, count, float(each[0]), float(each[1])))
    return rows


def _seconds(call: Callable[[], np.ndarray]) -> float:
    begun = time.process_time()
    call()
    return time.process_time() - begun


def main() -> None:
    """Print the table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=9, help="of each measurement; the median counts")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    rows = measure(options.repeats)
    if options.json:
        print(json.dumps({"rows": [asdict(r) for r in rows]}))
        return
    print(f"{'what':10}{'rows':>8}{'batched':>10}{'Pinocchio':>11}  [us a row (and step)]")
    for r in rows:
        print(f"{r.what:10}{r.rows:8}{r.batched:10.2f}{r.one_by_one:11.2f}")


if __name__ == "__main__":
    main()
