"""Motions for the subtasks of the benchmark's cells: success, cleanness, time and simulated steps, by planner.

Every motion is planned in a twin of seeded poses (true ones, or with errors), retimed, and replayed at 2 ms in a twin
of the true poses, where it is judged after the hand has let go and everything has settled for half a second.

    success   the reward is met, what had to be let go was let go, nothing moves any more
    clean     success, and no contact above 15 N but of fingers, handled thing and its supports, and nothing that the
              subtask does not name was moved by 20 mm, tipped, or opened
    passed    every residual of the safety table is kept in the true twin, clearances included

    python -m benchmarks.motion.motions --runs 20
    python -m benchmarks.motion.motions --runs 5 --motions open_door lift --planner predictive-sampling --json
    python -m benchmarks.motion.motions --runs 20 --pose-noise-mm 5 --jobs 2
"""

import argparse
import json
import multiprocessing
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from benchmarks.motion.motion_scenes import CHAIN, CHAIN_CELL, MOTIONS, Scene, draw_scene, draw_twin
from control.errors import RetimingError, RewardSpecError, StackError
from control.planners.choice import PLANNERS
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.kinematics import ArmKinematics
from control.robot.limits import panda_limits
from control.safety.certificate import CheckResult, Verdict
from control.safety.limits import SafetyLimits
from control.tasks.predicates import judge_term
from control.tasks.reward_spec import RewardSpec
from control.tasks.subtasks import posed_objects
from control.trajectory.samples import Trajectory
from control.twin_model import TwinModel
from sim_check.cells.loading import load_cell
from sim_check.twin.payloads import held_payloads
from sim_check.twin.twin import possible_twins, worlds_to_try
from sim_check.verdict.replay import replay
from sim_check.verdict.verdict import judge_trajectory

SUCCESS = ("reward_met", "released", "settled")
SIDE_EFFECTS = ("moved", "joint_moved", "tipped")
FORCES = ("contact_force", "unwanted_contact", "self_contact")
CLEAN_FORCE = 15.0  # [N]


@dataclass(frozen=True)
class Run:
    """One motion of one seed.

    Attributes:
        success, clean, passed: As above.
        wall_s, cpu_s: Of planning, in [s]; the CPU time of all threads.
        after_s: Wall time of retiming and of the judgement with one twin, in [s].
        steps: Simulated steps spent on planning.
        duration_s: Of the retimed motion in [s].
        force_n: Largest force in [N] on anything but fingers, handled thing and its supports.
        why: What went wrong, in words; empty where nothing did.
    """

    success: bool
    clean: bool
    passed: bool
    wall_s: float
    cpu_s: float
    after_s: float
    steps: int
    duration_s: float
    force_n: float
    why: str


@dataclass(frozen=True)
class Job:
    """One run to do."""

    motion: str
    seed: int
    planner: str
    pose_noise: float
    mismatch: bool
    nthread: int


def run_job(job: Job) -> Run:
    """Plan, retime and judge one motion, or the chain of motions."""
    if job.motion == "chain":
        return run_chain(job)
    began = time.perf_counter()
    try:
        scene = draw_scene(MOTIONS[job.motion], job.seed, job.pose_noise, job.mismatch)
    except StackError as error:
        return Run(False, False, False, time.perf_counter() - began, 0.0, 0.0, 0, 0.0, 0.0, f"no twin: {error}")
    return run_scene(job, scene, load_cell(MOTIONS[job.motion].cell).safety_limits())[0]


def run_scene(job: Job, scene: Scene, safety: SafetyLimits) -> tuple[Run, Trajectory | None]:
    """The same for a scene that is drawn already; also the trajectory that was judged."""
    rng = np.random.default_rng(job.seed)
    arm, robot, limits = ArmKinematics.from_urdf(), RobotModel.panda(), panda_limits()
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        if job.planner == "candidates":
            variants = possible_twins(scene.believed, rng, worlds_to_try(scene.believed))  # as a run does
            plan = plan_motion(
                scene.believed, scene.spec, safety, rng, kinematics=arm, nthread=job.nthread, variants=variants
            )
        else:
            plan = PLANNERS[job.planner](scene.believed, scene.spec, safety, rng, kinematics=arm, nthread=job.nthread)
    except RewardSpecError as error:
        return Run(False, False, False, time.perf_counter() - wall, 0.0, 0.0, 0, 0.0, 0.0, str(error)), None
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    if not isinstance(plan, MotionPlan):
        steps = int(plan.evidence.get("steps", 0))
        return Run(False, False, False, wall, cpu, 0.0, steps, 0.0, 0.0, f"{plan.kind}: {plan.message}"), None
    begun = time.perf_counter()
    try:
        trajectory = retime(plan.path, robot, limits, safety, payloads=held_payloads(scene.believed))
    except RetimingError as error:
        return Run(False, False, False, wall, cpu, 0.0, plan.stats.steps, 0.0, 0.0, f"not retimed: {error}"), None
    verdict = judge_trajectory(
        trajectory, scene.true, scene.spec, safety, limits, rng, perturbed=0, nthread=job.nthread, robot=robot
    )
    after = time.perf_counter() - begun
    success, clean, force = judged(verdict)
    why = "; ".join(_broken(c) for c in verdict.failed_checks[:3])
    run = Run(success, clean, verdict.passed, wall, cpu, after, plan.stats.steps, trajectory.duration, force, why)
    return run, trajectory


def judged(verdict: Verdict) -> tuple[bool, bool, float]:
    """Success, cleanness, and the largest force in [N] elsewhere than it belongs."""
    checks = {c.name: c for c in verdict.checks}
    if "simulation" in checks:
        return False, False, float("inf")
    success = all(checks[name].ok for name in SUCCESS)
    force = max(checks[name].worst for name in FORCES)
    clean = success and force < CLEAN_FORCE and all(checks[name].ok for name in SIDE_EFFECTS)
    return success, clean, force


def run_chain(job: Job) -> Run:
    """Several subtasks one after the other, each from the state in which the replay of the one before ended."""
    safety = load_cell(CHAIN_CELL).safety_limits()
    twin = draw_twin(CHAIN_CELL, job.seed)
    runs: list[Run] = []
    for spec in CHAIN:
        run, trajectory = run_scene(job, Scene(spec, twin, twin), safety)
        runs.append(run)
        if trajectory is None or not run.success:
            break
        twin = _played(twin, trajectory, safety)
    names = [s.primary.subject for s in CHAIN[: len(runs)]]
    return Run(
        success=len(runs) == len(CHAIN) and all(r.success for r in runs) and _all_hold(twin, CHAIN),
        clean=len(runs) == len(CHAIN) and all(r.clean for r in runs) and _all_hold(twin, CHAIN),
        passed=len(runs) == len(CHAIN) and all(r.passed for r in runs),
        wall_s=sum(r.wall_s for r in runs),
        cpu_s=sum(r.cpu_s for r in runs),
        after_s=sum(r.after_s for r in runs),
        steps=sum(r.steps for r in runs),
        duration_s=sum(r.duration_s for r in runs),
        force_n=max(r.force_n for r in runs),
        why="; ".join(f"{name}: {r.why}" for name, r in zip(names, runs, strict=True) if r.why),
    )


def _played(twin: TwinModel, trajectory: Trajectory, safety: SafetyLimits) -> TwinModel:
    """The twin after a trajectory was played in it."""
    rollouts, _ = replay(trajectory, [twin], safety.settle_time, nthread=1)
    qpos = rollouts[0].qpos[-1].copy()
    width = trajectory.gripper[-1].command.width if trajectory.gripper else twin.gripper_width
    return replace(twin, qpos=qpos, q=trajectory.q[-1].copy(), gripper_width=width)


def _all_hold(twin: TwinModel, specs: Sequence[RewardSpec]) -> bool:
    """Whether what was achieved first still holds at the end."""
    objects, nowhere = posed_objects(twin, twin.start()), np.zeros(3)
    return all(
        judge_term(s.primary, objects, nowhere, nowhere, None, twin.support_height, twin.joint_fractions()).met
        for s in specs
    )


def _broken(check: CheckResult) -> str:
    return f"{check.name} {check.worst:.3g} {check.unit} (limit {check.limit:.3g}; {' and '.join(check.bodies)})"


def summary(runs: Sequence[Run]) -> dict[str, Any]:
    """Counts and medians of one motion's runs."""

    def median(name: str) -> float:
        return float(statistics.median(getattr(r, name) for r in runs))

    forces = [r.force_n for r in runs if r.duration_s > 0]
    return {
        "runs": len(runs),
        "success": sum(r.success for r in runs),
        "clean": sum(r.clean for r in runs),
        "passed": sum(r.passed for r in runs),
        "median_wall_s": round(median("wall_s"), 2),
        "median_cpu_s": round(median("cpu_s"), 2),
        "median_retime_and_judge_s": round(median("after_s"), 2),
        "median_steps": int(median("steps")),
        "median_duration_s": round(median("duration_s"), 1),
        "peak_other_force_n": round(max(forces, default=0.0), 1),
        "failures": {k: r.why for k, r in enumerate(runs) if not r.clean},
    }


def table(summaries: dict[str, dict[str, Any]]) -> str:
    """The figures as text."""
    head = ("motion", "success", "clean", "passed", "wall s", "cpu s", "steps", "lasts s", "peak N")
    lines = ["{:18} {:>8} {:>8} {:>8} {:>7} {:>7} {:>9} {:>8} {:>7}".format(*head)]
    for name, s in summaries.items():
        n = s["runs"]
        lines.append(
            f"{name:18} {s['success']:>5}/{n:<2} {s['clean']:>5}/{n:<2} {s['passed']:>5}/{n:<2} "
            f"{s['median_wall_s']:>7} {s['median_cpu_s']:>7} {s['median_steps']:>9} {s['median_duration_s']:>8} "
            f"{s['peak_other_force_n']:>7}"
        )
        lines += [f"    seed {seed}: {why}" for seed, why in s["failures"].items()]
    return "\n".join(lines)


def run_all(jobs: list[Job], workers: int) -> Iterator[tuple[Job, Run]]:
    """Do all jobs, in processes of their own where there are several workers; results in the order of the jobs."""
    if workers == 1:
        yield from ((job, run_job(job)) for job in jobs)
        return
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from zip(jobs, pool.map(run_job, jobs), strict=True)


def main() -> int:
    """Run the benchmark; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--runs", type=int, default=20, help="runs of each motion, with seeds 0, 1, 2, ...")
    names = [*MOTIONS, "chain"]
    parser.add_argument("--motions", nargs="*", default=names, choices=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--planner", default="candidates", choices=sorted(PLANNERS))
    parser.add_argument("--pose-noise-mm", type=float, default=0.0, help="spread of perceived positions per axis")
    parser.add_argument("--mismatch", action="store_true", help="let the true model differ from the believed one")
    parser.add_argument("--jobs", type=int, default=1, help="processes; wall times count with 1 only")
    parser.add_argument("--runs-of-each", action="store_true", help="add every single run to the JSON")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    args = parser.parse_args()
    errors = args.pose_noise_mm > 0 or args.mismatch
    motions = [m for m in args.motions if m != "chain" or not errors]
    jobs = [
        Job(m, s, args.planner, args.pose_noise_mm / 1e3, args.mismatch, 2 if args.jobs == 1 else 1)
        for m in motions
        for s in range(args.runs)
    ]
    done: dict[str, list[Run]] = {m: [] for m in motions}
    for count, (job, run) in enumerate(run_all(jobs, args.jobs), 1):
        done[job.motion].append(run)
        word = "clean" if run.clean else "success" if run.success else "FAILED"
        print(f"[{count}/{len(jobs)}] {job.motion} {job.seed}: {word} {run.wall_s:.1f} s {run.why}", file=sys.stderr)
    summaries = {name: summary(runs) for name, runs in done.items() if runs}
    report: dict[str, Any] = {
        "planner": args.planner,
        "pose_noise_mm": args.pose_noise_mm,
        "mismatch": args.mismatch,
        "jobs": args.jobs,
        "motions": summaries,
    }
    if args.runs_of_each:
        report["runs"] = {name: [asdict(r) for r in runs] for name, runs in done.items()}
    print(json.dumps(report) if args.json else table(summaries))
    return 0


if __name__ == "__main__":
    sys.exit(main())
