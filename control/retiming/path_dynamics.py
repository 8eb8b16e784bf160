"""Torques and the hand's motion along a path, as bounds for a TOPP-RA profile, which has no limit on jerk."""

import numpy as np

from control.errors import RetimingError
from control.retiming.bounds import MotionBounds
from control.retiming.path_smoothing import SmoothPath
from control.retiming.toppra_profile import LARGE_SPEED, PathBounds, ToppraProfile, fastest_profile
from control.robot.dynamics import RobotModel

# Directions in which the hand's acceleration is bounded, instead of all: none is more than 2 % off.
DIRECTIONS = 8
LEAST_SPEED = 1e-3  # [rad/s]; below it a joint counts as standing


class PathDynamics:
    """Torque along a path as m(s) s'' + c(s) s'^2 + g(s), and how the hand moves.

    Args:
        path: Smooth path.
        robot: Rigid-body model.
        bounds: What the motion is held to.
        least: Grid intervals along the path, at least; each piece of the path gets three.
    """

    def __init__(self, path: SmoothPath, robot: RobotModel, bounds: MotionBounds, least: int) -> None:
        self.path, self.limits = path, bounds
        self.s = s = _grid(path, least)
        self.q, self.first, self.second = path(s), path(s, 1), path(s, 2)
        self.g = robot.gravity(self.q)
        self.m = robot.torque(self.q, np.zeros_like(self.q), self.first) - self.g
        self.c = robot.torque(self.q, self.first, self.second) - self.g
        self.velocity, self.acceleration = robot.tcp_motion(self.q, self.first, self.second)

    def check(self) -> None:
        """Raise RetimingError where the arm cannot even rest, or may not move as the path wants it to."""
        tau = self.limits.tau
        row, joint = np.unravel_index(int(np.argmax(np.abs(self.g) / tau)), self.g.shape)
        if abs(self.g[row, joint]) > tau[joint]:
            raise RetimingError(
                f"breaks torque even at rest {self.path.place(self.s[row])}: joint {joint + 1} needs "
                f"{abs(self.g[row, joint]):.1f} Nm against gravity, {tau[joint]:.1f} Nm is allowed. Carry less, or "
                "nearer to the base"
            )
        if self.limits.ends is None:
            return
        speed = self.limits.joint_speed(self.q, self.first)
        moving = np.abs(self.first) > 1e-6 * np.max(np.abs(self.first))
        standing = (speed < LEAST_SPEED) & moving
        standing[[0, -1]] = False  # at rest there
        if np.any(standing):
            row, joint = np.argwhere(standing)[0]
            upward = self.first[row, joint] > 0.0
            raise RetimingError(
                f"breaks joint_velocity {self.path.place(float(self.s[row]))}: joint {joint + 1} is at "
                f"{self.q[row, joint]:.4f} rad, so near its {'upper' if upward else 'lower'} end that it must not move "
                "towards it at all. Take a path that stays further away"
            )

    def fastest_profile(self) -> ToppraProfile:
        """The TOPP-RA profile on the grid: the fastest timing with jerk and torque rate unbounded.

        Raises:
            RetimingError: The solver finds none.
        """
        limits = self.limits
        speed = np.maximum(limits.joint_speed(self.q, self.first), LEAST_SPEED * 1e-3)
        slowness = np.max(np.abs(self.first) / speed, axis=1)
        a, b = [self.first, self.m], [self.second, self.c]
        low = [-limits.qdd + 0.0 * self.g, np.minimum(-limits.tau - self.g, 0.0)]
        high = [limits.qdd + 0.0 * self.g, np.maximum(limits.tau - self.g, 0.0)]
        for part, (top, most, _) in ((slice(0, 3), limits.hand), (slice(3, 6), limits.turn)):
            slowness = np.maximum(slowness, np.linalg.norm(self.velocity[:, part], axis=1) / top)
            along, bend = _in_their_plane(self.velocity[:, part], self.acceleration[:, part])
            a.append(along)
            b.append(bend)
            low.append(np.full_like(along, -most))
            high.append(np.full_like(along, most))
        return fastest_profile(
            PathBounds(
                s=self.s,
                a=np.concatenate(a, axis=1),
                b=np.concatenate(b, axis=1),
                low=np.concatenate(low, axis=1),
                high=np.concatenate(high, axis=1),
                cap=np.minimum(1.0 / np.maximum(slowness, 1e-9) ** 2, LARGE_SPEED),
            )
        )


def _grid(path: SmoothPath, least: int) -> np.ndarray:
    """Grid that resolves every knot interval, of at least `least` intervals."""
    intervals = len(path.breaks) - 1
    parts = max(3, -(-least // intervals))
    fractions = np.arange(parts) / parts
    inner = path.breaks[:-1, None] + np.diff(path.breaks)[:, None] * fractions
    return np.append(inner.ravel(), path.breaks[-1])


def _in_their_plane(velocity: np.ndarray, acceleration: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Components of two vectors (n, 3) along even directions in the plane of both, each (n, DIRECTIONS).

    A combination of both lies in that plane, so its length is bounded by bounding these components.
    """
    speed = np.linalg.norm(velocity, axis=1)
    axis = velocity / np.maximum(speed, 1e-12)[:, None]
    straight = np.sum(acceleration * axis, axis=1)
    across = np.linalg.norm(acceleration - straight[:, None] * axis, axis=1)
    angles = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    cos, sin = np.cos(angles), np.sin(angles)
    return speed[:, None] * cos, straight[:, None] * cos + across[:, None] * sin
