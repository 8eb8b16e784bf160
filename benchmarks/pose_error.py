"""How far perceived poses are from the truth, over seeded simulated cells.

The perception under test sees frames only; this script, a scorer, reads the simulated cell's truth.

    python -m benchmarks.pose_error --seeds 10
    python -m benchmarks.pose_error --cameras static wrist --json
"""

import argparse
import json
import sys
import time
from dataclasses import dataclass

import numpy as np

from perception.estimates import ObjectEstimate
from perception.frames import RgbdFrame
from perception.pipeline import Perception, perception_from_options
from sim_check.cells import load_cell
from sim_check.world import World, build_world

SCENES = (("cubes", {}), ("cubes-blocked", {}), ("fruit-bowl", {}), ("fruit-bowl", {"lemon_in_bowl": True}))


@dataclass(frozen=True)
class PoseError:
    """One estimate against the truth.

    Attributes:
        name: Object.
        position_mm: Distance of the centres.
        yaw_deg: Turn between the boxes, modulo a quarter turn for square footprints and a half turn for others;
            NaN for round things.
        extents_mm: Largest difference of a side.
        normalised: Distance of the centres by the spread that the estimate claims.
    """

    name: str
    position_mm: float
    yaw_deg: float
    extents_mm: float
    normalised: float


def compare(estimate: ObjectEstimate, pose: np.ndarray, extents: np.ndarray) -> PoseError:
    """Score one estimate.

    Args:
        estimate: As perceived.
        pose: True pose of the box centre in the world, shape (4, 4).
        extents: True full sizes in [m], shape (3,).
    """
    off = estimate.position - pose[:3, 3]
    yaw = float("nan")
    true_sides, sides = np.array(extents), np.array(estimate.extents)
    if estimate.shape == "box":
        turn = np.degrees(estimate.yaw - np.arctan2(pose[1, 0], pose[0, 0]))
        square = abs(true_sides[0] - true_sides[1]) < 0.1 * true_sides[:2].max()
        if not square and round(turn / 90) % 2:
            true_sides = true_sides[[1, 0, 2]]
        yaw = abs((turn + 45) % 90 - 45)
        if square:
            sides[:2], true_sides[:2] = np.sort(sides[:2]), np.sort(true_sides[:2])
    return PoseError(
        estimate.name,
        1e3 * float(np.linalg.norm(off)),
        float(yaw),
        1e3 * float(np.abs(sides - true_sides).max()),
        float(np.sqrt(np.mean((off / estimate.position_std) ** 2))),
    )


def score_world(world: World, perception: Perception, cameras: list[str], names: tuple[str, ...]):
    """Errors of one look at one world, names missed, names seen that are not there, and seconds."""
    frames = []
    for camera in cameras:
        colour, depth, pose, intrinsics = world.render(camera)
        frames.append(RgbdFrame(colour, depth, intrinsics, pose, 0.0, camera))
    started = time.perf_counter()
    scene = perception.perceive(frames, names)
    seconds = time.perf_counter() - started
    errors = [
        compare(o, world.object_pose(o.name), world.objects[o.name].extents)
        for o in scene.objects
        if o.name in world.objects
    ]
    missed = [name for name in world.object_names if name not in scene.names]
    invented = [name for name in scene.names if name not in world.objects]
    return errors, missed, invented, seconds


def summary(errors: list[PoseError]) -> dict[str, float]:
    """Median and 95 % quantile of every measure."""
    row: dict[str, float] = {"n": len(errors)}
    for key in ("position_mm", "yaw_deg", "extents_mm", "normalised"):
        values = np.array([getattr(e, key) for e in errors])
        values = values[np.isfinite(values)]
        for label, share in (("median", 0.5), ("p95", 0.95)):
            row[f"{key}_{label}"] = round(float(np.quantile(values, share)), 2) if len(values) else float("nan")
    return row


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
    for cell_name, options in SCENES:
        cell = load_cell(cell_name, options)
        for seed in range(args.first_seed, args.first_seed + args.seeds):
            world = build_world(cell, seed)
            # Names that are not there are asked for too: a detector must be able to say no.
            names = tuple(dict.fromkeys((*cell.objects, "banana", "green_block")))
            errors, lost, made_up, took = score_world(world, perception, args.cameras, names)
            world.close()
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
    for label, items in (("missed", missed), ("invented", invented)):
        print(f"{label}: {'; '.join(items) or 'none'}")
    for _, line in sorted(worst, reverse=True)[: args.worst]:
        print(line)


if __name__ == "__main__":
    main()
