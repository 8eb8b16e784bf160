"""Joint paths to retime: what a motion search makes, and what it should not make but might."""

import itertools

import numpy as np

from control.robot.dynamics import RobotModel
from control.robot.limits import REST_Q, panda_limits
from control.trajectory.samples import GripperCommand, JointPath, PathSegment

REST = np.array(REST_Q)
GRASP = GripperCommand("grasp", 0.04)
OPEN = GripperCommand("move", 0.08)


def polyline(corners: np.ndarray, step: float = 0.1) -> np.ndarray:
    """Waypoints at most `step` [rad] apart per joint along straight joint-space pieces."""
    pieces = [corners[:1]]
    for a, b in itertools.pairwise(corners):
        count = max(1, int(np.ceil(np.max(np.abs(b - a)) / step)))
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(pieces)


def random_path(rng: np.random.Generator, corners: int, spread: float | None = None) -> np.ndarray:
    """A polyline from REST through random corners: anywhere within the limits, or near REST when `spread` is given."""
    limits = panda_limits()
    low, high = limits.q_min + 0.05, limits.q_max - 0.05
    if spread is None:
        points = rng.uniform(low, high, (corners, 7))
    else:
        points = np.clip(REST + rng.normal(0.0, spread, (corners, 7)), low, high)
    return polyline(np.vstack([REST, points]))


def noisy(path: np.ndarray, rng: np.random.Generator, std: float) -> np.ndarray:
    """The path with white noise [rad] on all but its ends."""
    out = path.copy()
    out[1:-1] += rng.normal(0.0, std, out[1:-1].shape)
    return out


def reach_down(robot: RobotModel, position: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Joint positions with the tool centre point at a position in [m], fingers down, from a start near it."""
    down = np.diag([1.0, -1.0, -1.0])
    for _ in range(200):
        pose = robot.tcp_pose(q)
        turn = 0.5 * sum(np.cross(pose[:3, k], down[:, k]) for k in range(3))
        error = np.concatenate([position - pose[:3, 3], turn])
        if np.linalg.norm(error) < 1e-9:
            return q
        jacobian = robot.tcp_jacobian(q)
        q = q + 0.7 * jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-6 * np.eye(6), error)
    raise AssertionError(f"no joint positions found for {position}")


def straight_hand_path(robot: RobotModel, start: np.ndarray, goal: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Dense waypoints whose tool centre point moves on a straight line from start to goal in [m]."""
    rows = []
    for share in np.linspace(0.0, 1.0, 25):
        q = reach_down(robot, (1.0 - share) * start + share * goal, q)
        rows.append(q)
    return np.array(rows)


def pick_and_place(robot: RobotModel) -> JointPath:
    """Reach, approach, lift, carry, lower, retreat, home: seven segments, a grasp and a release."""
    grasp, place, above = np.array([0.5, -0.2, 0.03]), np.array([0.45, 0.25, 0.12]), np.array([0.0, 0.0, 0.12])
    before = reach_down(robot, grasp + above, REST)
    approach = straight_hand_path(robot, grasp + above, grasp, before)
    over = reach_down(robot, place + above, before)
    lower = straight_hand_path(robot, place + above, place, over)
    via = 0.5 * (before + over) + np.array([0.0, -0.2, 0.0, 0.1, 0.0, 0.0, 0.0])
    reach = polyline(np.vstack([REST, approach[0]]))
    carry = polyline(np.vstack([approach[0], via, lower[0]]))
    touching = (("red_cube", "crate"),)
    return JointPath(
        (
            PathSegment("reach", reach),
            PathSegment("approach", approach, GRASP, speed_scale=0.5),
            PathSegment("lift", approach[::-1], held="red_cube", touching=(("red_cube", "table"),), speed_scale=0.5),
            PathSegment("carry", carry, held="red_cube"),
            PathSegment("lower", lower, OPEN, held="red_cube", touching=touching, speed_scale=0.5),
            PathSegment("retreat", lower[::-1], touching=touching, speed_scale=0.5),
            PathSegment("home", polyline(np.vstack([lower[0], REST]))),
        )
    )
