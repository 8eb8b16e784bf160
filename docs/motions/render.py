"""Renders the picture of docs/motions.md: what motions do in the twin, one row each, at some of their stops.

Run from the checkout: MUJOCO_GL=egl .venv/bin/python docs/motions/render.py
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.motion.motion_scenes import MOTIONS, draw_scene
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.robot.limits import panda_limits
from control.simulation.rollouts import commands_for, roll_out
from sim_check.cells.loading import load_cell
from sim_check.models.render import FreeView, render_twin

SEED = 0
ROWS = ("remove_bar", "open_door", "remove_kettle", "turn")
SEGMENTS = {"drive": 2, "lift": 1, "carry": 1, "lower": 1, "approach": 1, "home": 1}  # pictures of each
FRAMES = 5
VIEW = FreeView(look_at=(0.45, 0.0, 0.22), distance=1.7, azimuth_deg=38.0, elevation_deg=-28.0)
SIZE = (248, 186)  # of each picture in [px]
COLOURS = 160


def frames_of(name: str) -> list[np.ndarray]:
    """Pictures of one motion: the middle or end of the segments that matter."""
    task = MOTIONS[name]
    scene = draw_scene(task, SEED)
    safety = load_cell(task.cell).safety_limits()
    plan = plan_motion(scene.believed, scene.spec, safety, np.random.default_rng(SEED))
    if not isinstance(plan, MotionPlan):
        raise SystemExit(f"{name}: {plan.message}")
    commands = commands_for(plan.path.segments, scene.believed, panda_limits())
    (rollout,), _ = roll_out([scene.believed], [commands], 2)
    rows, begin = [], 0
    for segment, (_, end) in zip(plan.path.segments, commands.stops, strict=True):
        count = SEGMENTS.get(segment.name, 0)
        rows += [begin + round((end - begin) * (k + 1) / count) for k in range(count)]
        begin = end
    rows = rows[: FRAMES - 1] + rows[-1:]
    return [render_twin(scene.believed, view=VIEW, qpos=rollout.qpos[row]) for row in rows]


def main() -> None:
    """Write motions.png beside this file."""
    strips = []
    for name in ROWS:
        small = [np.asarray(Image.fromarray(f).resize(SIZE, Image.Resampling.LANCZOS)) for f in frames_of(name)]
        small += [np.full_like(small[0], 255)] * (FRAMES - len(small))
        strips.append(np.hstack(small[:FRAMES]))
    picture = Image.fromarray(np.vstack(strips)).quantize(
        COLOURS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
    )
    picture.save(Path(__file__).with_name("motions.png"), optimize=True)


if __name__ == "__main__":
    main()
