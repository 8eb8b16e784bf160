"""Motions that bring a wrist camera to where it sees a region: what they see is predicted, how they move is judged.

Camera poses on shells around the region look at it; each is worth the share of the region's points that it would see:
in the picture, near enough, and with nothing known in between. What nobody has seen is taken for free there, as only
the look can tell. The arm's configurations for the best poses are filtered by geometry, and free ways lead to them. A
way through hidden space costs what its share is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.path_planning.collision_filter import Held, Phase
from control.path_planning.planning_context import PlanningContext, path_length
from control.robot.kinematics import ArmKinematics
from control.robot.limits import RobotLimits
from control.safety.limits import SafetyLimits
from control.safety.swept_volume import unseen_on_the_way
from control.seen_volume import FILLED, SeenVolume
from control.tasks.reward_spec import PALM, REST_POSITION, RewardTerm
from control.tasks.subtasks import Subtask
from control.trajectory.samples import JointPath, PathSegment
from control.twin_model import ARM_JOINTS, TwinModel

DISTANCES = (0.25, 0.4, 0.6, 0.8)  # [m] of a camera from what it looks at
NEAREST, FARTHEST = 0.15, 1.2  # [m] along the axis between which a small stereo camera tells enough
AZIMUTHS = 12
ELEVATIONS = np.radians([10.0, 30.0, 50.0, 75.0])
BORDER = 0.08  # share of the picture's width and height at each side that does not count
RAY_STEP = 0.02  # [m]
NEAR_POINT = 0.035  # [m] before a point that do not block the view of it: it may lie on a surface
MOST_POINTS = 160
SOLVED = 60  # camera poses for which the arm's joints are looked for
REACH = 0.85  # [m] from the shoulder to the camera beyond which no pose is worth a try
SHOULDER = np.array([0.0, 0.0, 0.333])  # in the base's frame in [m]
WAYS = 10  # free ways that are compared
OFFERED = 3  # of them, best first
LEAST_WORTH = 0.1  # share of the points below which a look is not worth its motion
EFFORT = 0.02  # share of the points that a [rad] of motion has to be worth
FAR = 0.2  # the same for a [m] of the camera's way, where joints are not known yet
CLOSER = 0.1  # share of the points that half of the distance is worth, where detail is wanted


@dataclass(frozen=True)
class WristCamera:
    """A pinhole camera that rides on the hand.

    Attributes:
        hand_T_camera: Pose of its optical frame (x right, y down, z forward) in the hand, shape (4, 4).
        size: Width and height of its picture in [px].
        focal: Focal lengths along x and y in [px].
        centre: Principal point in [px].
    """

    hand_T_camera: NDArray[np.float64]
    size: tuple[float, float]
    focal: tuple[float, float]
    centre: tuple[float, float]


@dataclass(frozen=True)
class LookPlan:
    """A motion that ends where the camera sees a region.

    Attributes:
        path: Of the arm, one segment.
        share: Share of the region's points that it should see at its end, 0..1.
        text: For people.
    """

    path: JointPath
    share: float
    text: str


def plan_look(
    twin: TwinModel,
    points: np.ndarray,
    camera: WristCamera,
    safety: SafetyLimits,
    limits: RobotLimits,
    rng: np.random.Generator,
    arm: ArmKinematics,
    closer: bool = False,
) -> list[LookPlan]:
    """Ways to see a region, best first; none where the camera cannot be brought to see enough of it.

    Args:
        twin: What is believed to stand around, with what was seen of it.
        points: Of the region in the world in [m], shape (n, 3).
        camera: On the hand.
        safety: The safety table. Where it refuses what nobody saw, so does this search.
        limits: Published limits of the robot.
        rng: Source of randomness.
        arm: With the twin's gripper.
        closer: Whether a nearer view is better than a farther one that sees as much.
    """
    if twin.seen is None or not len(points):
        return []
    if len(points) > MOST_POINTS:
        points = points[np.linspace(0, len(points) - 1, MOST_POINTS).astype(int)]
    term = RewardTerm("minimize_l2_distance", PALM, REST_POSITION, primary=True)
    context = PlanningContext(twin, Subtask("reach", None, None, 0.0, term), safety, limits, arm, rng)
    poses, distance = _camera_poses(points)
    worth = _visible(poses, points, camera, twin.seen)
    hand_T_tcp = np.eye(4)
    hand_T_tcp[2, 3] = twin.gripper.tcp_distance
    camera_T_tcp = np.linalg.inv(camera.hand_T_camera) @ hand_T_tcp
    now = (context.filter.tcp_pose(context.start_q) @ np.linalg.inv(camera_T_tcp))[:3, 3]
    detail = CLOSER * np.log2(distance) if closer else np.zeros(len(poses))
    within = np.linalg.norm(poses[:, :3, 3] - context.base_position - SHOULDER, axis=1) < REACH
    offered = np.flatnonzero((worth >= LEAST_WORTH) & within)
    promise = (worth - detail - FAR * np.linalg.norm(poses[:, :3, 3] - now, axis=1))[offered]
    order = offered[np.argsort(-promise, kind="stable")[:SOLVED]]
    owners, solutions = context.solve(poses[order] @ camera_T_tcp)
    value = [
        (worth - detail)[order[i]] - EFFORT * float(np.abs(q - context.start_q).max())
        for i, q in zip(owners, solutions, strict=True)
    ]
    found: list[tuple[float, LookPlan]] = []
    for k in np.argsort(-np.array(value), kind="stable") if value else ():
        if len(found) == WAYS:
            break
        path = _free_way(context, solutions[k], planner=not found)
        if path is None:
            continue
        hidden = _hidden_share(twin, twin.seen, path)
        if safety.unseen == "refuse" and hidden > safety.unseen_volume:
            continue
        share = float(worth[order[owners[k]]])
        text = f"look from {distance[order[owners[k]]]:.2f} m, {share:.0%} of it in view"
        plan = LookPlan(JointPath((PathSegment("look", path, held=twin.held),)), share, text)
        found.append((float(value[k]) - EFFORT * path_length(path) - hidden, plan))
    return [plan for _, plan in sorted(found, key=lambda pair: -pair[0])[:OFFERED]]


def _camera_poses(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses of a camera's optical frame around a region, shape (m, 4, 4), and their distances in [m], shape (m,).

    It looks at the middle of the region, and at the middles of both its halves along its longest direction; with its
    picture upright and upside down, as one of both may be out of the wrist's reach.
    """
    middle = points.mean(axis=0)
    along = (points - middle) @ np.linalg.svd(points - middle, full_matrices=False)[2][0]
    halves = [points[side].mean(axis=0) for side in (along < 0, along >= 0) if side.any()]
    spread = float(np.ptp(along))
    aims = [middle, *(halves if spread > 0.2 else [])]
    poses, distances = [], []
    for aim in aims:
        for distance in DISTANCES:
            for elevation in ELEVATIONS:
                for azimuth in np.arange(AZIMUTHS) * 2 * np.pi / AZIMUTHS:
                    away = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]) * np.cos(elevation)
                    away[2] = np.sin(elevation)
                    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
                    for turn in (1.0, -1.0):
                        pose = np.eye(4)
                        pose[:3, :3] = np.stack([turn * right, np.cross(-away, turn * right), -away], axis=1)
                        pose[:3, 3] = aim + distance * away
                        poses.append(pose)
                        distances.append(distance)
    return np.array(poses), np.array(distances)


def _visible(poses: np.ndarray, points: np.ndarray, camera: WristCamera, seen: SeenVolume) -> NDArray[np.float64]:
    """Share of some points that a camera would see from each pose, shape (m,)."""
    local = np.einsum("mji,mnj->mni", poses[:, :3, :3], points[None] - poses[:, None, :3, 3])
    ahead = np.maximum(local[..., 2], 1e-6)
    inside = (local[..., 2] > NEAREST) & (local[..., 2] < FARTHEST)
    for axis in range(2):
        pixel = camera.focal[axis] * local[..., axis] / ahead + camera.centre[axis]
        size = camera.size[axis]
        inside &= (pixel > BORDER * size) & (pixel < (1.0 - BORDER) * size)
    pose, point = np.nonzero(inside)
    origin, end = poses[pose, :3, 3], points[point]
    way = np.linalg.norm(end - origin, axis=1)
    clear = np.ones(len(pose), bool)
    for distance in np.arange(0.0, FARTHEST * 1.3, RAY_STEP):
        rows = np.flatnonzero(clear & (distance < way - NEAR_POINT))
        if not len(rows):
            break
        at = origin[rows] + (end[rows] - origin[rows]) * (distance / way[rows])[:, None]
        clear[rows] = seen.states(seen.index(at.T)) != FILLED
    out = np.zeros(inside.shape)
    out[pose, point] = clear
    return out.mean(axis=1)


def _free_way(context: PlanningContext, end: np.ndarray, planner: bool) -> np.ndarray | None:
    """A free way to a configuration with what the hand holds, shape (n, 7), or None."""
    name, width = context.twin.held, context.twin.gripper_width
    held, phase = None, Phase.FREE
    if name is not None:
        held = Held(np.linalg.inv(context.filter.tcp_pose(context.start_q)) @ context.objects[name].pose)
        phase = Phase.CARRY
    if not context.filter.clear(end, phase, width, held):
        return None
    return context.way(context.start_q, end, phase, width, held, planner)


def _hidden_share(twin: TwinModel, seen: SeenVolume, path: np.ndarray) -> float:
    """Share of a path's way that is hidden."""
    qpos = np.tile(twin.qpos, (len(path), 1))
    qpos[:, [int(twin.model.joint(name).qposadr[0]) for name in ARM_JOINTS]] = path
    # A path's waypoints are close together; their times only say that each of them is looked at.
    return unseen_on_the_way(seen, twin.model, qpos, np.arange(len(path), dtype=float)).hidden
