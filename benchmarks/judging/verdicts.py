"""Whether the verdict turns down what is unsafe and lets pass what is not: injected faults and good motions.

Motions are planned in the built-in cells over seeds and retimed, as a run does. Into each of them every fault that it
offers an occasion for is injected by construction, one at a time (`benchmarks.judging.injected_faults`), and it is
varied in ways that keep every promise: as planned, slower, by another grasp or way, beside an obstacle at the clearance
that is asked for plus a millimetre.

    detected       the verdict does not pass
    right reason   the check that is meant for the fault is broken, by the right body where there is one
    false alarm    a good motion does not pass
    unreliable     a planned motion that fails in one of ten worlds, and again in one of ten more, drawn independently
                   of those that the verdict draws: whether it is good is a matter of chance, so it is told apart,
                   passed or not

Faults are judged in the nominal twin alone, where they are certain; good motions in six perturbed twins as well, as in
a run. The time of one verdict is that of a motion of 8 s with 32 perturbed twins on two threads.

    python -m benchmarks.judging.verdicts --seeds 6
    python -m benchmarks.judging.verdicts --seeds 1 --motions lift cube_on_crate --jobs 1 --json
"""

import argparse
import json
import multiprocessing
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.judging.injected_faults import FAULTS
from benchmarks.motion.base_motions import Base, Case, plan_base, rescaled
from benchmarks.motion.motion_scenes import MOTIONS
from benchmarks.motion.placed_obstacles import Wanted, obstacle_below
from control.errors import RetimingError
from control.retiming.retime import retime
from control.robot.limits import REST_Q
from control.safety.certificate import Verdict
from control.tasks.subtasks import palm_at
from control.trajectory.samples import SAMPLE_TIME, Trajectory
from sim_check.twin.payloads import held_payloads
from sim_check.twin.twin import possible_twins
from sim_check.verdict.judged_replay import ReplayQuestion, judge_replay
from sim_check.verdict.verdict import judge_in_detail

GOOD_TWINS = 6  # perturbed, as in a run
TIMED_MOTION, TIMED_SECONDS, TIMED_TWINS, TIMED_THREADS = "cube_on_crate", 8.0, 32, 2
WORLDS = 10  # in which a good motion is played beforehand and keeps everything; or all but one of twice as many
NEAR = 0.001  # [m] beyond the clearances that are asked for


@dataclass(frozen=True)
class Judged:
    """One motion and what became of it.

    Attributes:
        base: Name of the planned motion.
        kind: Fault or kind of good motion.
        fault: Whether it had to be turned down.
        passed: Whether the verdict let it pass.
        reliable: Whether it is certain to be good, where it is no fault.
        right_reason: Whether the check that is meant for the fault was broken.
        seconds: Wall time of the verdict.
        why: Broken checks.
    """

    base: str
    kind: str
    fault: bool
    passed: bool
    right_reason: bool
    seconds: float
    why: str
    reliable: bool = True


def good_cases(base: Base, rng: np.random.Generator) -> list[Case]:
    """Variants of a planned motion that keep every promise."""
    own = Case("as_planned", base.trajectory, base.twin, base.spec, base.safety)
    cases = [own]
    slower = base.trajectory
    for index in range(len(slower.segments)):
        if np.ptp(slower.q[slower.segments[index].start : slower.segments[index].stop], axis=0).max() > 0:
            slower = rescaled(slower, index, float(rng.uniform(0.5, 0.9)))
    cases.append(replace(own, kind="slower", trajectory=slower))
    for path in base.others[:1]:
        try:
            other = retime(path, base.robot, base.limits, base.safety, payloads=held_payloads(base.twin))
            cases.append(replace(own, kind="other_way", trajectory=other))
        except RetimingError:
            continue
    s = base.safety
    wanted = Wanted(NEAR, arm=s.arm_clearance, finger=s.finger_clearance, held=s.held_clearance)
    twin = obstacle_below(base, wanted, rng)
    if twin is not None:
        cases.append(replace(own, kind="near_obstacle", twin=twin))
    return cases


def judge_base(motion: str, seed: int) -> list[Judged] | str:
    """Plan one motion, vary it, inject faults, and judge it all."""
    base = plan_base(motion, seed)
    if isinstance(base, str):
        return f"{motion} {seed}: no motion, {base}"
    rng = np.random.default_rng([seed, *motion.encode()])
    out = [replace(_judged(base, c, False), reliable=_reliable(c, rng)) for c in good_cases(base, rng)]
    if not out[0].passed:
        return out  # what is not safe as planned is no motion with one fault
    for make in FAULTS.values():
        case = make(base, rng)
        if case is not None:
            out.append(_judged(base, case, True))
    return out


def _reliable(case: Case, rng: np.random.Generator) -> bool:
    """Whether a motion keeps everything in nearly every world that might be, of draws that no verdict sees."""
    question = ReplayQuestion(case.trajectory, case.spec, frozenset(), case.safety, palm_at(case.twin, REST_Q))

    def failures() -> int:
        worlds = possible_twins(case.twin, rng, WORLDS)
        return sum(not judge_replay(question, world, nominal=False).kept for world in worlds)

    first = failures()
    return first == 0 or (first == 1 and failures() == 0)


def _judged(base: Base, case: Case, fault: bool) -> Judged:
    begun = time.perf_counter()
    verdict = judge_in_detail(
        case.trajectory,
        case.twin,
        case.safety,
        base.limits,
        np.random.default_rng(0),
        spec=case.spec,
        perturbed=0 if fault else GOOD_TWINS,
        nthread=1,
        robot=base.robot,
        payload=case.payload,
    ).verdict
    seconds = time.perf_counter() - begun
    return Judged(base.name, case.kind, fault, verdict.passed, _right(case, verdict), seconds, _why(verdict))


def _right(case: Case, verdict: Verdict) -> bool:
    return any(
        c.name in case.checks and (case.culprit is None or case.culprit in c.bodies) for c in verdict.failed_checks
    )


def _why(verdict: Verdict) -> str:
    broken = [
        f"{c.name} {c.worst:.3g} {c.unit} (limit {c.limit:.3g}; {' and '.join(c.bodies)})"
        for c in verdict.failed_checks
    ]
    return "; ".join(broken) or f"{verdict.successes}/{verdict.trials} perturbed twins"


def lengthened(trajectory: Trajectory, seconds: float) -> Trajectory:
    """The same motion, its last segment slower or faster so that it lasts as long as is wanted."""
    segment = trajectory.segments[-1]
    own = (segment.stop - segment.start) * SAMPLE_TIME
    return rescaled(trajectory, len(trajectory.segments) - 1, own / (own + seconds - trajectory.duration))


def time_of_one(repeats: int = 3) -> dict[str, Any]:
    """Wall and CPU time of one verdict in [s]: a motion of `TIMED_SECONDS` with `TIMED_TWINS` perturbed twins."""
    base = plan_base(TIMED_MOTION, 0)
    assert isinstance(base, Base)
    trajectory = lengthened(base.trajectory, TIMED_SECONDS)
    wall, cpu = [], []
    for _ in range(repeats):
        began = time.perf_counter(), time.process_time()
        judge_in_detail(
            trajectory,
            base.twin,
            base.safety,
            base.limits,
            np.random.default_rng(0),
            spec=base.spec,
            perturbed=TIMED_TWINS,
            nthread=TIMED_THREADS,
            robot=base.robot,
        )
        wall.append(time.perf_counter() - began[0])
        cpu.append(time.process_time() - began[1])
    return {
        "motion_s": round(trajectory.duration, 2),
        "perturbed_twins": TIMED_TWINS,
        "threads": TIMED_THREADS,
        "wall": round(min(wall), 2),
        "cpu": round(min(cpu), 2),
    }


def summary(runs: Sequence[Judged]) -> dict[str, Any]:
    """Counts by fault and kind."""
    faults: dict[str, Any] = {}
    for kind in FAULTS:
        of = [r for r in runs if r.fault and r.kind == kind]
        faults[kind] = {
            "motions": len(of),
            "detected": sum(not r.passed for r in of),
            "right_reason": sum(r.right_reason for r in of),
        }
    good = [r for r in runs if not r.fault and r.reliable]
    unreliable = [r for r in runs if not r.fault and not r.reliable]
    kinds = sorted({r.kind for r in good})
    return {
        "faults": faults,
        "good": {
            "motions": len(good),
            "false_alarms": sum(not r.passed for r in good),
            "kinds": {
                k: {
                    "motions": sum(r.kind == k for r in good),
                    "false_alarms": sum(r.kind == k and not r.passed for r in good),
                }
                for k in kinds
            },
        },
        "unreliable": {
            "motions": len(unreliable),
            "refused": sum(not r.passed for r in unreliable),
            "names": [f"{r.base} {r.kind}" for r in unreliable],
        },
        "missed": [f"{r.base} {r.kind}: {r.why}" for r in runs if r.fault and (r.passed or not r.right_reason)],
        "alarms": [f"{r.base} {r.kind}: {r.why}" for r in good if not r.passed],
    }


def table(report: dict[str, Any]) -> str:
    """The figures as text."""
    lines = [f"{'fault':16} {'motions':>8} {'detected':>9} {'right reason':>13}"]
    lines += [
        f"{name:16} {f['motions']:>8} {f['detected']:>9} {f['right_reason']:>13}"
        for name, f in report["faults"].items()
    ]
    lines += ["", f"{'good motions':16} {'motions':>8} {'false alarms':>13}"]
    lines += [f"{name:16} {g['motions']:>8} {g['false_alarms']:>13}" for name, g in report["good"]["kinds"].items()]
    lines += [f"{'all':16} {report['good']['motions']:>8} {report['good']['false_alarms']:>13}"]
    unreliable = report["unreliable"]
    lines += [f"unreliable, told apart: {unreliable['motions']}, of which {unreliable['refused']} are refused"]
    lines += [f"missed, or caught by another check: {text}" for text in report["missed"]]
    lines += [f"false alarm: {text}" for text in report["alarms"]]
    lines += [f"no motion: {text}" for text in report["not_planned"]]
    one = report["seconds_per_verdict"]
    lines += [
        "",
        f"one verdict, motion of {one['motion_s']} s in {one['perturbed_twins']} perturbed twins on {one['threads']} "
        f"threads: {one['wall']} s ({one['cpu']} s of CPU)",
        f"one verdict in the nominal twin alone: {one['nominal']} s; with {GOOD_TWINS} perturbed twins on one thread: "
        f"{one['good']} s",
    ]
    return "\n".join(lines)


def _judge_all(jobs: list[tuple[str, int]], workers: int) -> Iterator[list[Judged] | str]:
    if workers == 1:
        yield from (judge_base(*job) for job in jobs)
        return
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(_spread, jobs)


def _spread(job: tuple[str, int]) -> list[Judged] | str:
    return judge_base(*job)


def main() -> int:
    """Run the benchmark; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=6, help="seeds 0, 1, 2, ... of each planned motion")
    parser.add_argument(
        "--motions", nargs="*", default=list(MOTIONS), choices=list(MOTIONS), metavar="NAME", help=", ".join(MOTIONS)
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes that share the motions")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    args = parser.parse_args()
    jobs = [(m, s) for s in range(args.seeds) for m in args.motions]
    one = time_of_one()  # first, while nothing else of this runs
    runs: list[Judged] = []
    not_planned: list[str] = []
    for count, result in enumerate(_judge_all(jobs, args.jobs), 1):
        if isinstance(result, str):
            not_planned.append(result)
        else:
            runs += result
        shown = result if isinstance(result, str) else f"{len(result)} verdicts"
        print(f"[{count}/{len(jobs)}] {' '.join(map(str, jobs[count - 1]))}: {shown}", file=sys.stderr)
        for run in [] if isinstance(result, str) else result:
            if run.passed == run.fault or (run.fault and not run.right_reason):
                print(f"    {run.kind} {'passed' if run.passed else 'refused'}: {run.why}", file=sys.stderr)
    one["nominal"] = round(statistics.median([r.seconds for r in runs if r.fault] or [0.0]), 2)
    one["good"] = round(statistics.median([r.seconds for r in runs if not r.fault] or [0.0]), 2)
    report = {"seeds": args.seeds, **summary(runs), "not_planned": not_planned, "seconds_per_verdict": one}
    print(json.dumps(report) if args.json else table(report))
    return 0


if __name__ == "__main__":
    sys.exit(main())
