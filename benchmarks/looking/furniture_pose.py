"""How far perceived furniture and its doors are from the truth, over seeded simulated cells.

The perception under test sees frames and the sizes in the cell file; this script, a scorer, reads the truth. Doors are
set to random fractions, three in ten of them closed.

    python -m benchmarks.looking.furniture_pose --seeds 6
    python -m benchmarks.looking.furniture_pose --cameras static
"""

import argparse
import time
from dataclasses import dataclass

import mujoco
import numpy as np

from perception.geometry.prepared_frame import PreparedFrame
from perception.known_shapes.articulated_fit import KnownFit, fit_known
from sim_check.cells.loading import load_cell
from sim_check.furniture.known_models import known_models
from sim_check.furniture.mjcf import set_fractions
from sim_check.world.world import World, build_world

CELLS = ("cabinet-closed", "cabinet-open", "kitchen-explore", "composite-explore")
CLOSED_SHARE = 0.3


@dataclass(frozen=True)
class FurnitureError:
    """One fit against the truth.

    Attributes:
        name: Of the furniture.
        position_mm: Distance of the centres on the support.
        yaw_deg: Of the furniture; modulo a quarter turn for what looks the same after one.
        joints: Error of each joint in degrees or mm, with its spread and whether it turns.
    """

    name: str
    position_mm: float
    yaw_deg: float
    joints: tuple[tuple[float, float, bool], ...]


def set_doors(world: World, rng: np.random.Generator) -> None:
    """Put every joint without a spring to a random fraction."""
    for thing in world.furniture.values():
        drawn = {p.name: 0.0 if rng.random() < CLOSED_SHARE else rng.uniform() for p in thing.parts if p.stiffness == 0}
        set_fractions(world.model, world.data.qpos, thing, drawn)
    mujoco.mj_forward(world.model, world.data)


def compare(fit: KnownFit, world: World) -> FurnitureError:
    """Score one fit."""
    true = world.object_pose(fit.model.name)
    turn = np.linalg.inv(true) @ fit.world_T_model
    yaw = float(np.degrees(np.arctan2(turn[1, 0], turn[0, 0])))
    if fit.model.extents[0] == fit.model.extents[1]:
        yaw = (yaw + 45) % 90 - 45
    joints = []
    for part, fraction, spread in zip(fit.model.parts, fit.fractions, fit.fraction_std, strict=True):
        turns = part.kind == "hinge"
        unit = part.opened * (180 / np.pi if turns else 1e3)
        joints.append((abs(fraction - world.joint_fraction(part.name)) * unit, spread * unit, turns))
    off = fit.world_T_model[:2, 3] - true[:2, 3]
    return FurnitureError(fit.model.name, 1e3 * float(np.linalg.norm(off)), abs(yaw), tuple(joints))


def main() -> None:
    """Parse, run, print."""
    parser = argparse.ArgumentParser(description="Errors of furniture and doors over seeded simulated cells")
    parser.add_argument("--seeds", type=int, default=6, help="seeds per cell")
    parser.add_argument("--cameras", nargs="+", default=["static", "right", "wrist"], help="those that a cell has")
    args = parser.parse_args()
    errors: list[FurnitureError] = []
    missed: list[str] = []
    seconds = []
    for cell_name in CELLS:
        cell = load_cell(cell_name)
        models = known_models(cell.furniture)
        for seed in range(args.seeds):
            world = build_world(cell, seed)
            set_doors(world, np.random.default_rng(seed))
            frames = []
            for camera in (c.name for c in world.cameras if c.name in args.cameras):
                colour, depth, pose, lens = world.render(camera)
                frames.append(PreparedFrame(colour, depth, lens, pose, 0.0, camera))
            started = time.process_time()
            fits = fit_known(frames, list(models.values()), frames[0].support)
            seconds.append((time.process_time() - started) / len(models))
            for name, fit in fits.items():
                if isinstance(fit, str):
                    missed.append(f"{cell_name} seed {seed}: {name}: {fit}")
                else:
                    errors.append(compare(fit, world))
            world.close()
    joints = [j for e in errors for j in e.joints]
    rows = {
        "position mm": [e.position_mm for e in errors],
        "yaw deg": [e.yaw_deg for e in errors],
        "doors deg": [j[0] for j in joints if j[2]],
        "slides mm": [j[0] for j in joints if not j[2]],
        "joint error / spread": [j[0] / j[1] for j in joints],
    }
    print(f"cameras {' + '.join(args.cameras)}; {np.median(seconds):.2f} s CPU a piece of furniture")
    print(f"{'':22}{'n':>4}{'median':>9}{'95 %':>9}{'worst':>9}")
    for label, values in rows.items():
        print(
            f"{label:22}{len(values):>4}{np.median(values):>9.2f}{np.quantile(values, 0.95):>9.2f}{max(values):>9.2f}"
        )
    print(f"missed: {'; '.join(missed) or 'none'}")


if __name__ == "__main__":
    main()
