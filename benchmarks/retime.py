"""How long retiming takes, how near its motions are to the bound, and what of the limits they use.

Every motion is held against the limits by the independent checker; the script fails when one is broken. The bound is
the time-optimal law on the same smooth path without limits on jerk and torque rate.

    python -m benchmarks.retime
    python -m benchmarks.retime --seeds 50 --json
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from control.limits import panda_limits
from control.on_path_stop import stop_on_path
from control.retime import retime_with_report
from control.robot import RobotModel
from control.safety import SafetyLimits
from control.trajectory import JointPath, PathSegment
from control.trajectory_checks import check_trajectory
from tests.arm_paths import noisy, pick_and_place, polyline, random_path


@dataclass(frozen=True)
class Row:
    """Figures of one kind of path, medians and worst over its seeds.

    Attributes:
        kind: What was retimed.
        runs: How many.
        duration_s: Median duration of the motions.
        retime_ms, retime_ms_worst: CPU time of retiming.
        check_ms, check_model_ms: Median CPU time of the checker without and with torques and hand speeds.
        stop_ms: Median CPU time of planning a stop at a random moment.
        stop_s: Longest stop.
        ratio, ratio_worst: Moving time relative to the bound.
        deviation_mrad: Largest deviation from the waypoints.
        broken: Checks that were broken.
    """

    kind: str
    runs: int
    duration_s: float
    retime_ms: float
    retime_ms_worst: float
    check_ms: float
    check_model_ms: float
    stop_ms: float
    stop_s: float
    ratio: float
    ratio_worst: float
    deviation_mrad: float
    broken: int


def measure(kind: str, paths: list[JointPath], robot: RobotModel, rng: np.random.Generator) -> Row:
    """Retime, check and stop every path."""
    limits, safety = panda_limits(), SafetyLimits()
    retiming, checking, modelled, stopping, stops, ratios, deviations, durations = ([] for _ in range(8))
    broken = 0
    for path in paths:
        (trajectory, report), spent = timed(lambda path=path: retime_with_report(path, robot, limits, safety))
        retiming.append(spent)
        _, spent = timed(lambda t=trajectory: check_trajectory(t, limits, safety))
        checking.append(spent)
        checks, spent = timed(lambda t=trajectory: check_trajectory(t, limits, safety, robot.torque, robot.tcp_poses))
        modelled.append(spent)
        broken += sum(not check.ok for check in checks)
        index = int(rng.integers(len(trajectory.q)))
        stop, spent = timed(lambda t=trajectory, k=index: stop_on_path(t, k, limits))
        stopping.append(spent)
        stops.append(len(stop.q) * 1e-3)
        ratios.append(report.ratio)
        deviations.append(report.deviation)
        durations.append(trajectory.duration)
    return Row(
        kind=kind,
        runs=len(paths),
        duration_s=float(np.median(durations)),
        retime_ms=1e3 * float(np.median(retiming)),
        retime_ms_worst=1e3 * max(retiming),
        check_ms=1e3 * float(np.median(checking)),
        check_model_ms=1e3 * float(np.median(modelled)),
        stop_ms=1e3 * float(np.median(stopping)),
        stop_s=max(stops),
        ratio=float(np.median(ratios)),
        ratio_worst=max(ratios),
        deviation_mrad=1e3 * max(deviations),
        broken=broken,
    )


def timed(work: Callable):
    """Result of a call and its CPU time in [s]."""
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def main() -> int:
    """Print a table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, help="random paths of each kind")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    options = parser.parse_args()
    robot = RobotModel.panda()

    def single(make: Callable[[np.random.Generator], np.ndarray]) -> list[JointPath]:
        seeds = (np.random.default_rng(seed) for seed in range(options.seeds))
        return [JointPath((PathSegment("reach", make(rng)),)) for rng in seeds]

    kinds = {
        "pick and place": [pick_and_place(robot)] * 3,
        "corners near rest": single(lambda rng: random_path(rng, 3, 0.3)),
        "corners anywhere": single(lambda rng: random_path(rng, 3)),
        "noisy, 0.5 mrad": single(lambda rng: noisy(polyline(random_path(rng, 2, 0.3), 0.02), rng, 5e-4)),
        "short, about 10 mrad": single(lambda rng: random_path(rng, 1, 0.01)),
    }
    rows = [measure(kind, paths, robot, np.random.default_rng(0)) for kind, paths in kinds.items()]
    if options.json:
        print(json.dumps({"rows": [asdict(row) for row in rows]}))
    else:
        print(f"{'path':22}{'runs':>5}{'motion':>9}{'retime (worst)':>20}{'check':>8}{'+model':>9}", end="")
        print(f"{'stop':>8}{'longest':>9}{'ratio (worst)':>16}{'deviation':>11}{'broken':>8}")
        for r in rows:
            print(f"{r.kind:22}{r.runs:5d}{r.duration_s:7.2f} s", end="")
            print(f"{r.retime_ms:8.0f} ({r.retime_ms_worst:5.0f}) ms", end="   ")
            print(f"{r.check_ms:5.1f} ms{r.check_model_ms:6.0f} ms{r.stop_ms:5.1f} ms{r.stop_s:7.3f} s", end="")
            print(f"{r.ratio:8.3f} ({r.ratio_worst:5.3f}){r.deviation_mrad:6.2f} mrad{r.broken:8d}")
    return 1 if any(row.broken for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
