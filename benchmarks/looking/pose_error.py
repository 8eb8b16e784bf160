"""How far perceived poses are from the truth, over seeded simulated cells.

The perception under test sees frames only; this script, a scorer, reads the simulated cell's truth.

    python -m benchmarks.looking.pose_error --seeds 10
    python -m benchmarks.looking.pose_error --cameras static wrist --json
"""

import argparse
import json
import sys
import time

import numpy as np

from perception.estimates import Shape
from perception.evaluation.coverage import Claimed, claimed, coverage, coverage_table
from perception.evaluation.metrics import PoseError, compare, summary
from perception.frames import RgbdFrame
from perception.ground_truth import TrueObject
from perception.pipeline import Perception, perception_from_options
from sim_check.cells.loading import load_cell
from sim_check.world.world import World, build_world

SCENES = (("cubes", {}), ("cubes-blocked", {}), ("fruit-bowl", {}), ("fruit-bowl", {"lemon_in_bowl": True}))


def true_object(world: World, name: str) -> TrueObject:
    """What a simulated cell knows about one of its things."""
    thing = world.objects[name]
    shape: Shape | None = "sphere" if thing.rolls and not thing.container else "cylinder" if thing.container else None
    return TrueObject(name, world.object_pose(name), thing.extents, shape)


def score_world(world: World, perception: Perception, cameras: list[str], names: tuple[str, ...]):
    """Errors of one look at one world, claims of spreads, names missed, names seen that are not there, and seconds."""
    frames = []
    for camera in cameras:
        colour, depth, pose, intrinsics = world.render(camera)
        frames.append(RgbdFrame(colour, depth, intrinsics, pose, 0.0, camera))
    started = time.perf_counter()
    scene = perception.perceive(frames, names)
    seconds = time.perf_counter() - started
    errors = [compare(o, true_object(world, o.name)) for o in scene.objects if o.name in world.objects]
    claims = [claimed(o, true_object(world, o.name)) for o in scene.objects if o.name in world.objects]
    missed = [name for name in world.object_names if name not in scene.names]
    invented = [name for name in scene.names if name not in world.objects]
    return errors, claims, missed, invented, seconds


def main() -> None:
    """Parse, run, print."""
    parser = argparse.ArgumentParser(description="Pose error against truth over seeded simulated cells")
    parser.add_argument("--seeds", type=int, default=10, help="seeds per cell")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--cameras", nargs="+", default=["static"])
    parser.add_argument("--detector", default="default")
    parser.add_argument("--segmenter", default="default")
    parser.add_argument("--worst", type=int, default=0, help="also list the worst estimates")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    args = parser.parse_args()
    perception = perception_from_options(args.detector, args.segmenter)
    by_name: dict[str, list[PoseError]] = {}
    worst: list[tuple[float, str]] = []
    missed, invented, seconds = [], [], []
    claimed_all: list[Claimed] = []
    for cell_name, options in SCENES:
        cell = load_cell(cell_name, options)
        for seed in range(args.first_seed, args.first_seed + args.seeds):
            world = build_world(cell, seed)
            # Names that are not there are asked for too: a detector must be able to say no.
            names = tuple(dict.fromkeys((*cell.objects, "banana", "green_block")))
            errors, claims, lost, made_up, took = score_world(world, perception, args.cameras, names)
            world.close()
            claimed_all += claims
            for e in errors:
                by_name.setdefault(e.name, []).append(e)
                worst.append((e.position_mm, f"{cell_name} seed {seed} {e}"))
            missed += [f"{cell_name} seed {seed}: {name}" for name in lost]
            invented += [f"{cell_name} seed {seed}: {name}" for name in made_up]
            seconds.append(took)
            print(".", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    rows = {name: summary(errors) for name, errors in sorted(by_name.items())}
    rows["all"] = summary([e for errors in by_name.values() for e in errors])
    result = {
        "perception": perception.name,
        "cameras": args.cameras,
        "objects": rows,
        "spreads": coverage(claimed_all),
        "missed": missed,
        "invented": invented,
        "seconds_median": round(float(np.median(seconds)), 3),
    }
    if args.json:
        print(json.dumps(result))
        return
    print(f"{perception.name}; cameras {' + '.join(args.cameras)}; {result['seconds_median']} s a look")
    print(f"{'object':14}{'n':>4}{'position mm':>18}{'yaw deg':>16}{'extents mm':>16}{'error/spread':>16}")
    for name, row in rows.items():
        cells = [
            f"{row[f'{k}_median']:.1f} / {row[f'{k}_p95']:.1f}"
            for k in ("position_mm", "yaw_deg", "extents_mm", "normalised")
        ]
        print(f"{name:14}{row['n']:>4}{cells[0]:>18}{cells[1]:>16}{cells[2]:>16}{cells[3]:>16}")
    print("median / 95 % quantile")
    print(coverage_table(result["spreads"]))
    for label, items in (("missed", missed), ("invented", invented)):
        print(f"{label}: {'; '.join(items) or 'none'}")
    for _, line in sorted(worst, reverse=True)[: args.worst]:
        print(line)


if __name__ == "__main__":
    main()
