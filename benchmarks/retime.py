"""How long retiming takes, how near its motions are to the bound, and what of the limits they use.

Every motion is held against the limits by the independent checker, and every sample against the waypoints' polyline;
the script fails when a limit is broken. The bound is the time-optimal law on the same smooth path without limits on
jerk and torque rate. Times are CPU times; one motion is retimed beforehand, as the first one imports the solver.

    python -m benchmarks.retime
    python -m benchmarks.retime --seeds 50 --json
"""

import argparse
import itertools
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from control.limits import panda_limits
from control.on_path_stop import stop_on_path
from control.playback import Playback
from control.retime import retime, retime_with_report
from control.robot import RobotModel
from control.safety import SafetyLimits
from control.trajectory import SAMPLE_TIME, JointPath, PathSegment
from control.trajectory_checks import check_trajectory
from tests.arm_paths import noisy, pick_and_place, polyline, random_path

CHUNK = 500  # samples compared with the polyline at once; bounds memory


@dataclass(frozen=True)
class Row:
    """Figures of one path.

    Attributes:
        kind: What sort of path it is.
        name: Which one.
        duration: Of the motion in [s].
        ratio: Moving time relative to the bound, 1 = cannot be faster.
        violations: Limits that the checker found broken.
        deviation: Largest joint difference of a sample from the nearest point of the waypoints' polyline in [rad].
        compute, check, check_model: CPU time of retiming, and of the checker without and with torques and hand speeds,
            in [s].
        stop_compute: CPU time of planning a stop at a random moment in [s].
        stop: How long that stop takes in [s].
    """

    kind: str
    name: str
    duration: float
    ratio: float
    violations: int
    deviation: float
    compute: float
    check: float
    check_model: float
    stop_compute: float
    stop: float


def measure(kind: str, name: str, path: JointPath, robot: RobotModel, rng: np.random.Generator) -> Row:
    """Retime, check and stop a path."""
    limits, safety = panda_limits(), SafetyLimits()
    (trajectory, report), compute = timed(lambda: retime_with_report(path, robot, limits, safety))
    _, check = timed(lambda: check_trajectory(trajectory, limits, safety))
    checks, check_model = timed(lambda: check_trajectory(trajectory, limits, safety, robot.torque, robot.tcp_poses))
    index = int(rng.integers(len(trajectory.q)))
    stop, stop_compute = timed(lambda: stop_on_path(Playback.of(trajectory), index, limits))
    moving = {stretch.name: trajectory.q[stretch.start : stretch.stop] for stretch in trajectory.segments}
    deviations = [deviation_from_polyline(moving[s.name], s.q) for s in path.segments if s.name in moving]
    return Row(
        kind=kind,
        name=name,
        duration=trajectory.duration,
        ratio=report.ratio,
        violations=sum(not check.ok for check in checks),
        deviation=max(deviations),
        compute=compute,
        check=check,
        check_model=check_model,
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
    """One line for each kind: medians, and worst values in brackets."""
    print(f"{'path':22}{'runs':>5}{'motion':>9}{'retime (worst)':>20}{'check':>8}{'+model':>9}", end="")
    print(f"{'stop':>8}{'longest':>9}{'ratio (worst)':>16}{'deviation':>11}{'broken':>8}")
    for kind, group in itertools.groupby(rows, key=lambda row: row.kind):
        runs = list(group)

        def median(key: str, runs: list[Row] = runs) -> float:
            return float(np.median([getattr(run, key) for run in runs]))

        print(f"{kind:22}{len(runs):5d}{median('duration'):7.2f} s", end="")
        print(f"{1e3 * median('compute'):8.0f} ({1e3 * max(r.compute for r in runs):5.0f}) ms", end="   ")
        print(f"{1e3 * median('check'):5.1f} ms{1e3 * median('check_model'):6.0f} ms", end="")
        print(f"{1e3 * median('stop_compute'):5.1f} ms{max(r.stop for r in runs):7.3f} s", end="")
        print(f"{median('ratio'):8.3f} ({max(r.ratio for r in runs):5.3f})", end="")
        print(f"{1e3 * max(r.deviation for r in runs):6.2f} mrad{sum(r.violations for r in runs):8d}")


def main() -> int:
    """Print a table, or one JSON object with the figures of every path."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, help="random paths of each kind")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    options = parser.parse_args()
    robot = RobotModel.panda()

    def single(make: Callable[[np.random.Generator], np.ndarray]) -> dict[str, JointPath]:
        rngs = {seed: np.random.default_rng(seed) for seed in range(options.seeds)}
        return {f" {seed}": JointPath((PathSegment("reach", make(rng)),)) for seed, rng in rngs.items()}

    placing = pick_and_place(robot)
    kinds = {
        "pick and place": {"": placing},
        "corners near rest": single(lambda rng: random_path(rng, 3, 0.3)),
        "corners anywhere": single(lambda rng: random_path(rng, 3)),
        "noisy, 0.5 mrad": single(lambda rng: noisy(polyline(random_path(rng, 2, 0.3), 0.02), rng, 5e-4)),
        "short, about 10 mrad": single(lambda rng: random_path(rng, 1, 0.01)),
    }
    retime(placing, robot, panda_limits(), SafetyLimits())
    rng = np.random.default_rng(0)
    rows = [measure(kind, kind + n, path, robot, rng) for kind, paths in kinds.items() for n, path in paths.items()]
    if options.json:
        paths = [
            {
                "name": row.name,
                "ratio": row.ratio,
                "violations": row.violations,
                "max_path_deviation_rad": row.deviation,
                "compute_ms": 1e3 * row.compute,
            }
            for row in rows
        ]
        print(json.dumps({"paths": paths}))
    else:
        print_table(rows)
    return 1 if any(row.violations for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
