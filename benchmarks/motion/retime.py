"""How near retimed motions are to the fastest possible, whether they keep all limits, and how long retiming takes.

Every path is retimed under four sets of limits:

    published    all that the robot's maker allows
    derated      what a run uses by default (control/safety/limits.py)
    gentle 20    half the speed, a quarter of the acceleration, jerk 20 times the acceleration
    gentle 10    the same with jerk 10 times the acceleration

Every motion is held against the limits by the independent checker, and every sample against the waypoints' polyline;
the script fails when a limit is broken. The ratio is to the time-optimal timing (TOPP-RA, on a fine grid) on the same
smooth path without limits on jerk and torque rate. Very short moves cannot come near it: within a few milliseconds it
is the jerk that counts. `jerk_bound_s` tells a bound of another kind, the time that the slowest single joint needs from
rest to rest under its own speed, acceleration and jerk limits, whatever the path. Times are CPU times; one motion is
retimed beforehand, as the first one imports the solver.

    python -m benchmarks.motion.retime
    python -m benchmarks.motion.retime --seeds 10 --json
"""

import argparse
import itertools
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.motion.arm_paths import REST, noisy, pick_and_place, polyline, random_path
from benchmarks.motion.planner_paths import stored_paths
from control.retiming.retime import retime, retime_with_report, shortest_moving_time
from control.retiming.segment_timing import RetimingOptions
from control.robot.dynamics import RobotModel
from control.robot.limits import RobotLimits, panda_limits
from control.safety.limits import SafetyLimits
from control.safety.trajectory_checks import check_trajectory
from control.trajectory.on_path_stop import stop_on_path
from control.trajectory.playback import Playback
from control.trajectory.samples import SAMPLE_TIME, JointPath, PathSegment

CHUNK = 500  # samples compared with the polyline at once; bounds memory
BOUND_GRID = RetimingOptions(grid=2000)  # finer ones change the bound by less than 0.3 %
RECORDED = {"cube_on_crate": "carry", "place_in_cabinet": "reach", "turn": "home"}  # motions played back with noise
RATES = {50: 5e-4, 250: 3e-4, 500: 2e-4}  # [Hz]: standard deviation of the noise in [rad]
TINY = (1e-3, 1e-4, 1e-6)  # [rad]


@dataclass(frozen=True)
class Row:
    """Figures of one path under one set of limits.

    Attributes:
        limits: Which set.
        kind: What sort of path it is.
        name: Which one.
        duration: Moving time in [s].
        bound: Shortest moving time of the same smooth path with unbounded jerk and torque rate, in [s].
        jerk_bound: What the slowest joint of each segment needs alone from its first to its last position, in [s].
        broken: Limits that the checker found broken.
        deviation: Largest joint difference of a sample from the nearest point of the waypoints' polyline in [rad].
        segments: How many of them move.
        compute, check: CPU time of retiming, and of the checker, in [s].
        stop_compute: CPU time of planning a stop at a random moment in [s].
        stop: How long that stop takes in [s].
    """

    limits: str
    kind: str
    name: str
    duration: float
    bound: float
    jerk_bound: float
    broken: tuple[str, ...]
    deviation: float
    segments: int
    compute: float
    check: float
    stop_compute: float
    stop: float

    @property
    def ratio(self) -> float:
        """Moving time relative to the bound, 1 = cannot be faster."""
        return self.duration / self.bound

    def as_json(self) -> dict[str, object]:
        """Figures with their units in the keys."""
        return {
            "name": f"{self.limits}: {self.kind}: {self.name}",
            "limits": self.limits,
            "kind": self.kind,
            "ratio": self.ratio,
            "violations": len(self.broken),
            "broken": self.broken,
            "max_path_deviation_rad": self.deviation,
            "compute_ms": 1e3 * self.compute,
            "duration_s": self.duration,
            "bound_s": self.bound,
            "jerk_bound_s": self.jerk_bound,
            "segments": self.segments,
        }


def limit_sets() -> dict[str, tuple[RobotLimits, SafetyLimits]]:
    """Limits of the robot and shares of them, by name."""
    robot = panda_limits()
    published = SafetyLimits(
        velocity_scale=1.0,
        acceleration_scale=1.0,
        hand_speed=robot.cartesian_speed,
        hand_angular_speed=robot.angular_speed,
    )
    gentle = SafetyLimits(
        velocity_scale=0.5,
        acceleration_scale=0.25,
        hand_speed=0.5 * robot.cartesian_speed,
        hand_angular_speed=0.5 * robot.angular_speed,
    )
    sets = {"published": (robot, published), "derated": (robot, SafetyLimits())}
    for factor in (20, 10):
        jerk = factor * gentle.acceleration_scale * robot.qdd
        sets[f"gentle {factor}"] = replace(robot, qddd=jerk), gentle
    return sets


def paths(robot: RobotModel, seeds: int) -> dict[str, dict[str, JointPath]]:
    """All paths by kind and name."""
    planned = stored_paths()
    limits = panda_limits()

    def single(q: np.ndarray) -> JointPath:
        return JointPath((PathSegment("move", q),))

    def rng(seed: int) -> np.random.Generator:
        return np.random.default_rng(seed)

    stretched = REST.copy()
    stretched[[1, 3, 5]] = 0.9, -0.13, 1.9  # the elbow nearly straight
    aside = stretched + np.array([0.8, 0.1, 0.0, 0.02, 0.0, 0.1, 0.0])
    wrist = REST.copy()
    wrist[5] = 0.02  # the axes of joints 5 and 7 nearly in line
    turned = wrist + np.array([0.4, 0.2, 0.0, 0.3, 0.8, 0.3, -0.8])
    there = polyline(np.vstack([REST, REST + 0.35, REST + np.array([0.6, 0.2, -0.3, 0.5, 0.1, 0.2, 0.4])]), 0.02)
    swing = REST + np.sin(np.linspace(0.0, 3.0 * np.pi, 120))[:, None] * np.array([0.3, 0.1, 0.0, 0.2, 0.0, 0.1, 0.5])
    return {
        "planner": {**planned, "pick_and_place": pick_and_place(robot)},
        "recorded with noise": {
            f"{name} at {rate} Hz": single(_recorded(planned[name], part, robot, limits, rate, rng(k)))
            for k, ((name, part), rate) in enumerate(itertools.product(RECORDED.items(), RATES))
        },
        "near singular": {
            "elbow": single(polyline(np.vstack([REST, stretched, REST + 0.1]), 0.05)),
            "elbow, along": single(polyline(np.vstack([stretched, aside]), 0.05)),
            "wrist": single(polyline(np.vstack([REST, wrist, turned]), 0.05)),
        },
        "long": {f"{k}": single(random_path(rng(40 + k), 6)) for k in range(2)},
        "reversing": {
            "same way back": single(np.vstack([there, there[-2::-1]])),
            "to and fro": single(swing),
            "one joint": single(polyline(REST + np.outer([0, 1, -1, 1, 0], 0.3 * np.eye(7)[3]), 0.01)),
        },
        "corners": {f"{k}": single(random_path(rng(k), 3, 0.3)) for k in range(seeds)},
        "corners anywhere": {f"{k}": single(random_path(rng(k), 3)) for k in range(seeds)},
        "tiny": {
            f"{size:g} rad": single(np.vstack([REST, REST + size * np.array([1.0, -1, 0.5, 1, -0.3, 0.2, 1])]))
            for size in TINY
        },
    }


def _recorded(
    path: JointPath, part: str, robot: RobotModel, limits: RobotLimits, rate: int, rng: np.random.Generator
) -> np.ndarray:
    """A segment as if recorded from a moving arm: samples at a rate in [Hz], with noise."""
    chosen = next(s for s in path.segments if s.name == part)
    q = retime(JointPath((replace(chosen, gripper=None),)), robot, limits, SafetyLimits()).q
    rows = np.append(np.arange(0, len(q) - 1, 1000 // rate), len(q) - 1)
    return noisy(q[rows], rng, RATES[rate])


def alone(distance: np.ndarray, speed: np.ndarray, acceleration: np.ndarray, jerk: np.ndarray) -> float:
    """Shortest time in [s] in which every joint can go its distance from rest to rest, all of shape (7,).

    Each joint's fastest profile is up, hold and down, its acceleration a trapezoid (or a triangle, where the speed or
    the distance is too short for the full acceleration).
    """
    worst = 0.0
    for d, v, a, j in zip(np.abs(distance), speed, acceleration, jerk, strict=True):
        if d == 0.0:
            continue
        up = v / a + a / j if v >= a * a / j else 2.0 * np.sqrt(v / j)
        if d >= v * up:
            needed = up + d / v
        elif d >= 2.0 * a**3 / j**2:
            peak = 0.5 * a * (np.sqrt((a / j) ** 2 + 4.0 * d / a) - a / j)
            needed = 2.0 * (peak / a + a / j)
        else:
            needed = 4.0 * np.cbrt(d / (2.0 * j))
        worst = max(worst, float(needed))
    return worst


def measure(
    key: tuple[str, str, str],
    path: JointPath,
    robot: RobotModel,
    limits: RobotLimits,
    safety: SafetyLimits,
    rng: np.random.Generator,
) -> Row:
    """Retime, check and stop a path; key says which limits, kind and path it is."""
    (trajectory, report), compute = timed(lambda: retime_with_report(path, robot, limits, safety))
    checks, check = timed(lambda: check_trajectory(trajectory, limits, safety, robot.torque, robot.tcp_poses))
    index = int(rng.integers(len(trajectory.q)))
    stop, stop_compute = timed(lambda: stop_on_path(Playback.of(trajectory), index, limits))
    moving = {stretch.name: trajectory.q[stretch.start : stretch.stop] for stretch in trajectory.segments}
    segments = [s for s in path.segments if s.name in moving and np.any(s.q != s.q[0])]
    deviations = [deviation_from_polyline(moving[s.name], s.q) for s in segments]
    accelerations = limits.qdd * safety.acceleration_scale
    return Row(
        *key,
        duration=sum(s.duration for s in report.segments),
        bound=shortest_moving_time(path, robot, limits, safety, BOUND_GRID),
        jerk_bound=sum(
            alone(s.q[-1] - s.q[0], limits.qd * safety.velocity_scale * s.speed_scale, accelerations, limits.qddd)
            for s in segments
        ),
        broken=tuple(c.name for c in checks if not c.ok),
        deviation=max(deviations),
        segments=len(segments),
        compute=compute,
        check=check,
        stop_compute=stop_compute,
        stop=(len(stop.q) - 1 - index) * SAMPLE_TIME,
    )


def deviation_from_polyline(q: np.ndarray, waypoints: np.ndarray) -> float:
    """Largest joint difference of any sample (n, 7) from the nearest point of a polyline (m, 7), in [rad]."""
    start, along = waypoints[:-1], np.diff(waypoints, axis=0)
    length = np.maximum(np.sum(along**2, axis=1), 1e-18)
    worst = 0.0
    for first in range(0, len(q), CHUNK):
        gap = q[first : first + CHUNK, None] - start
        share = np.clip(np.einsum("nmj,mj->nm", gap, along) / length, 0.0, 1.0)
        gap = np.abs(gap - share[:, :, None] * along)
        worst = max(worst, float(np.max(np.min(np.max(gap, axis=2), axis=1))))
    return worst


def timed(work: Callable):
    """Result of a call and its CPU time in [s]."""
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def print_table(rows: list[Row]) -> None:
    """One line for each set of limits and kind: medians, and worst values in brackets."""
    print(f"{'limits':11}{'path':21}{'runs':>5}{'motion':>9}{'ratio (worst)':>16}{'retime (worst)':>19}", end="")
    print(f"{'check':>9}{'stop':>8}{'longest':>9}{'deviation':>12}{'broken':>8}")
    for (limits, kind), group in itertools.groupby(rows, key=lambda row: (row.limits, row.kind)):
        runs = list(group)

        def median(key: str, runs: list[Row] = runs) -> float:
            return float(np.median([getattr(run, key) for run in runs]))

        print(f"{limits:11}{kind:21}{len(runs):5d}{median('duration'):7.2f} s", end="")
        print(f"{median('ratio'):8.3f} ({max(r.ratio for r in runs):5.3f})", end="")
        print(f"{1e3 * median('compute'):8.0f} ({1e3 * max(r.compute for r in runs):4.0f}) ms", end="")
        print(f"{1e3 * median('check'):6.0f} ms{1e3 * median('stop_compute'):5.1f} ms", end="")
        print(f"{max(r.stop for r in runs):7.3f} s{1e3 * max(r.deviation for r in runs):7.2f} mrad", end="")
        print(f"{sum(len(r.broken) for r in runs):8d}")


def main() -> int:
    """Print a table, or one JSON object with the figures of every path."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="random paths round corners of each kind")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    options = parser.parse_args()
    robot, rng = RobotModel.panda(), np.random.default_rng(0)
    kinds = paths(robot, options.seeds)  # this retimes, which imports the solver
    rows = [
        measure((name, kind, which), path, robot, limits, safety, rng)
        for name, (limits, safety) in limit_sets().items()
        for kind, members in kinds.items()
        for which, path in members.items()
    ]
    if options.json:
        print(json.dumps({"paths": [row.as_json() for row in rows]}))
    else:
        print_table(rows)
    return 1 if any(row.broken for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
