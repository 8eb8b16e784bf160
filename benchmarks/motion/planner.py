"""What planners cost beyond simulation: their CPU time over that of the same simulated steps in bare `mujoco.batch`.

Each planner plans seeded tasks while the batches that it simulates are written down; then exactly these batches (the
same models, start states, controls, batch sizes and threads) are simulated again and nothing else. Times are CPU times
of the whole process, threads included. Where the rest goes is estimated by looking at the stack every 5 ms of CPU time.
A planner that does not reach a goal is measured all the same.

    python -m benchmarks.motion.planner
    python -m benchmarks.motion.planner --seeds 5 --planners candidates --json
"""

import argparse
import json
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import FrameType

import numpy as np
from mujoco import batch as mjbatch

from benchmarks.scenes.furniture_twins import cabinet, sliding, with_cube
from benchmarks.scenes.tabletop_twins import cubes, fruit, only, red_on_crate
from control.errors import ConfigError
from control.planners.choice import PLANNERS, Planner, planner_named
from control.planners.result import MotionPlan
from control.robot.kinematics import ArmKinematics
from control.safety.limits import SafetyLimits
from control.simulation.batches import SimulatedBatch
from control.tasks.reward_spec import RewardSpec
from control.twin_model import TwinModel

TASKS: dict[str, Callable[[], tuple[TwinModel, RewardSpec]]] = {
    "place a cube on a crate": lambda: (cubes(), red_on_crate()),
    "put an apple in a bowl": lambda: (fruit(), only("minimize_l2_distance", "apple", "bowl")),
    "lift a cube": lambda: (cubes(), only("set_obj_z_position", "red_cube", None, 0.25)),
    "open a door": lambda: (cabinet(), only("set_joint_fraction", "cabinet_left_door", value=0.6)),
    "open a sliding door": lambda: (sliding(), only("set_joint_fraction", "cabinet_door", value=1.0)),
    "put a cube in a cabinet": lambda: (with_cube(1.0, 1.0), only("minimize_l2_distance", "cube", "cabinet")),
}
LOOK = 0.005  # [s] of CPU time between two looks at the stack
# What is counted apart: the outermost of these functions (of all of a file where none is named) on the stack.
PARTS = {
    "kinematics": (("control/robot/kinematics.py", None),),
    "filter": (("control/path_planning/collision_filter.py", None),),
    "recording": (("control/simulation/motion_recording.py", "record_motion"),),
    "scoring": (("control/tasks/motion_cost.py", None), ("control/planners/sampling_cost.py", None)),
}


@dataclass(frozen=True)
class Row:
    """Figures of one planner on one task with one seed.

    Attributes:
        planner, task: Names.
        found: Whether a motion was found.
        steps: Simulated steps.
        cpu: CPU time of planning in [s].
        bare: CPU time of the same steps in bare `mujoco.batch` in [s].
        parts: Estimated CPU time by part in [s].
    """

    planner: str
    task: str
    found: bool
    steps: int
    cpu: float
    bare: float
    parts: dict[str, float]

    @property
    def ratio(self) -> float:
        """Planning over bare simulation; infinite where nothing was simulated."""
        return self.cpu / self.bare if self.bare > 0 else float("inf")


class StackLooks:
    """Counts in which part of the planner the main thread is, every `LOOK` seconds of the process's CPU time.

    Python looks only between its own instructions: long calls into the simulator count once, so its time has to be
    measured otherwise; the parts counted here consist of short calls.
    """

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def __enter__(self) -> "StackLooks":
        self._before = signal.signal(signal.SIGPROF, self._look)
        signal.setitimer(signal.ITIMER_PROF, LOOK, LOOK)
        return self

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, self._before)

    def _look(self, _number: int, frame: FrameType | None) -> None:
        found = None
        while frame is not None:
            code = frame.f_code
            for part, places in PARTS.items():
                if any(code.co_filename.endswith(f) and name in (None, code.co_name) for f, name in places):
                    found = part
            frame = frame.f_back
        if found is not None:
            self._counts[found] += 1

    @property
    def seconds(self) -> dict[str, float]:
        """Estimated CPU time by part in [s]."""
        return {part: self._counts[part] * LOOK for part in PARTS}


def measure(name: str, planner: Planner, task: str, seed: int, arm: ArmKinematics, nthread: int) -> Row:
    """Plan a task, then simulate the same batches bare."""
    twin, spec = TASKS[task]()
    batches: list[SimulatedBatch] = []
    with StackLooks() as looks:
        began = time.process_time()
        result = planner(
            twin, spec, SafetyLimits(), np.random.default_rng(seed), arm, nthread=nthread, observe=batches.append
        )
        cpu = time.process_time() - began
    began = time.process_time()
    for batch in batches:
        simulate_bare(batch)
    bare = time.process_time() - began
    steps = sum(batch.steps for batch in batches)
    return Row(name, task, isinstance(result, MotionPlan), steps, cpu, bare, looks.seconds)


def simulate_bare(batch: SimulatedBatch) -> np.ndarray:
    """Simulate a batch and record nothing; the configurations at the end, shape (n, nq)."""
    first = batch.models[0]
    sims = mjbatch.Batch(first, len(batch.models), batch.nthread)
    if any(model is not first for model in batch.models):
        sims.set_models(list(batch.models))
    qpos = sims.bind("qpos")
    qpos[:], sims.bind("qvel")[:] = batch.qpos, batch.qvel
    sims.bind("qacc_warmstart")[:] = batch.warmstart
    sims.rollout(batch.controls.shape[1], batch.controls, record=())
    return qpos


def summary(rows: Sequence[Row]) -> dict[str, dict]:
    """By planner: figures of each task (means over seeds, ratio of their sums) and the median ratio of all runs.

    A ratio is None where nothing was simulated.
    """
    out: dict[str, dict] = {}
    for name in dict.fromkeys(row.planner for row in rows):
        own = [row for row in rows if row.planner == name]
        tasks = {}
        for task in dict.fromkeys(row.task for row in own):
            runs = [row for row in own if row.task == task]
            cpu, bare = (float(np.mean([getattr(r, k) for r in runs])) for k in ("cpu", "bare"))
            tasks[task] = {
                "cpu_s": cpu,
                "bare_cpu_s": bare,
                "ratio": cpu / bare if bare > 0 else None,
                "steps": float(np.mean([r.steps for r in runs])),
                "found": sum(r.found for r in runs),
                "runs": len(runs),
                "parts_cpu_s": {part: float(np.mean([r.parts[part] for r in runs])) for part in PARTS},
            }
        median = float(np.median([r.ratio for r in own]))
        out[name] = {"tasks": tasks, "ratio_median": median if np.isfinite(median) else None}
    return out


def print_table(planners: dict[str, dict]) -> None:
    """One line for each planner and task, and the median ratio of each planner."""
    for name, figures in planners.items():
        print(f"{name:25}{'found':>7}{'steps':>10}{'CPU':>9}{'bare':>9}{'ratio':>7}", end="")
        print("".join(f"{part:>12}" for part in PARTS) + f"{'the rest':>12}")
        for task, f in figures["tasks"].items():
            rest = f["cpu_s"] - f["bare_cpu_s"] - sum(f["parts_cpu_s"].values())
            ratio = f"{f['ratio']:7.2f}" if f["ratio"] is not None else "      -"
            print(f"  {task:23}{f['found']:4d}/{f['runs']}{f['steps']:10.0f}", end="")
            print(f"{f['cpu_s']:7.2f} s{f['bare_cpu_s']:7.2f} s{ratio}", end="")
            print("".join(f"{seconds:10.2f} s" for seconds in (*f["parts_cpu_s"].values(), rest)))
        median = figures["ratio_median"]
        print(f"  median ratio of all runs: {'-' if median is None else f'{median:.2f}'}\n")


def main() -> int:
    """Print a table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2, help="seeds 0, 1, ... of each task")
    parser.add_argument("--planners", nargs="+", default=sorted(PLANNERS), help="names of planners")
    parser.add_argument("--tasks", nargs="+", default=sorted(TASKS), choices=sorted(TASKS), help="names of tasks")
    parser.add_argument("--threads", type=int, default=1, help="threads for simulation")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    options = parser.parse_args()
    try:
        planners = {name: planner_named(name) for name in options.planners}
    except ConfigError as error:
        parser.error(str(error))
    arm = ArmKinematics.from_urdf()
    rows = []
    for name, planner in planners.items():
        for task in options.tasks:
            TASKS[task]()  # built once, outside of any measurement
            for seed in range(options.seeds):
                rows.append(measure(name, planner, task, seed, arm, options.threads))
                print(f"{name}, {task}, seed {seed}: ratio {rows[-1].ratio:.2f}", file=sys.stderr)
    figures = summary(rows)
    if options.json:
        print(json.dumps({"planner": figures}))
    else:
        print_table(figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
