"""Joint paths that the motion search found, stored for the retiming benchmark.

One motion of each task of `benchmarks.motion.motion_scenes`, planned in a twin of the true poses of its built-in cell.
They are stored because planning takes minutes and follows the machine's simulation to the last bit; this writes the
file anew:

    python -m benchmarks.motion.planner_paths
"""

import json
import sys
from pathlib import Path

import numpy as np

from control.planners.result import MotionPlan
from control.trajectory.samples import GripperCommand, JointPath, PathSegment

FILE = Path(__file__).with_name("data") / "planner_paths.npz"


def stored_paths() -> dict[str, JointPath]:
    """The stored paths by task, segments in order with all that retiming reads of them."""
    with np.load(FILE) as arrays:
        q, notes = arrays["q"], json.loads(str(arrays["notes"]))
    return {name: JointPath(tuple(_segment(note, q) for note in segments)) for name, segments in notes.items()}


def _segment(note: dict, q: np.ndarray) -> PathSegment:
    gripper = None if note["gripper"] is None else GripperCommand(**note["gripper"])
    return PathSegment(note["name"], q[note["start"] : note["stop"]], gripper, note["held"], (), note["speed_scale"])


def store(paths: dict[str, JointPath]) -> None:
    """Write the file."""
    rows: list[np.ndarray] = []
    notes: dict[str, list[dict]] = {}
    count = 0
    for name, path in paths.items():
        notes[name] = []
        for s in path.segments:
            gripper = None if s.gripper is None else vars(s.gripper)
            note = {"name": s.name, "start": count, "stop": count + len(s.q), "held": s.held, "gripper": gripper}
            notes[name].append({**note, "speed_scale": s.speed_scale})
            rows.append(np.asarray(s.q, float))
            count += len(s.q)
    FILE.parent.mkdir(exist_ok=True)
    np.savez_compressed(FILE, q=np.concatenate(rows), notes=np.array(json.dumps(notes)))


def main() -> int:
    """Plan every task with seed 0 and store what was found."""
    from benchmarks.motion.motion_scenes import MOTIONS, draw_scene
    from control.planners.motion_search import plan_motion
    from sim_check.cells.loading import load_cell

    paths = {}
    for name, task in MOTIONS.items():
        scene = draw_scene(task, 0)
        safety = load_cell(task.cell).safety_limits()
        plan = plan_motion(scene.believed, scene.spec, safety, np.random.default_rng(0))
        if not isinstance(plan, MotionPlan):
            print(f"{name}: none found ({plan.kind}: {plan.message})", file=sys.stderr)
            continue
        paths[name] = plan.path
        print(f"{name}: {[(s.name, len(s.q)) for s in plan.path.segments]}", file=sys.stderr)
    store(paths)
    return 0


if __name__ == "__main__":
    sys.exit(main())
