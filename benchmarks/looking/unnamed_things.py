"""What a look says of things that nobody named, over seeded simulated cells: false ones, missed ones, and seconds.

Every built-in cell is looked at as a run does, with the names of its file: whatever is unnamed then is false. The
second row of a cell has one to three further boxes, cans and bottles of random sizes on the table that nobody asks for:
each part of their visible surface should lie in some hull.

    python -m benchmarks.looking.unnamed_things --seeds 5
    python -m benchmarks.looking.unnamed_things --cells cubes --seeds 20 --json
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

import numpy as np

from control.errors import StackError
from control.robot.limits import REST_Q
from perception.frames import RgbdFrame
from perception.geometry.prepared_frame import prepared
from perception.pipeline import perception_from_options
from perception.unexplained.unnamed_things import Known, UnnamedThings
from sim_check.cells.loading import CellConfig, builtin_cells, load_cell
from sim_check.cells.simulation_config import PlacementConfig
from sim_check.furniture.known_models import known_models
from sim_check.models.known_forms import known_forms
from sim_check.models.robot_region import RobotRegions
from sim_check.world.world import World, build_world

HIDDEN = ("grey_box", "black_can", "white_bottle")
SEEN_PIXELS = 150  # [px] in one camera; fewer are no thing at least half in view
OUTSIDE = 0.015  # [m] by which a visible point may lie outside of all hulls


@dataclass
class Row:
    """What was counted in the looks at one cell.

    Attributes:
        cell: Its name, with "+ hidden" where there are further things.
        looks: How many.
        false: Unnamed things where nothing unnamed stands.
        hidden, missed: Further things in view, and those with less than half of their visible surface in a hull.
        inside: Shares of the visible surface of each that lies in a hull.
        growth: Volumes of hulls by those of the boxes of their things.
        ms: Milliseconds that the search for unnamed things took.
        named_ms: Milliseconds of the look before.
        notes: What was false or missed.
    """

    cell: str
    looks: int = 0
    false: int = 0
    hidden: int = 0
    missed: int = 0
    inside: list[float] = field(default_factory=list)
    growth: list[float] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)
    named_ms: list[float] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def with_hidden(cell: CellConfig, rng: np.random.Generator) -> CellConfig:
    """The cell with one to three things more, for the simulation only."""
    assert cell.simulation is not None
    extra = []
    for name in HIDDEN[: rng.integers(1, 4)]:
        side, tall = rng.uniform(0.03, 0.09, 2), rng.uniform(0.04, 0.30)
        sizes = (side[0], side[1], tall) if "box" in name else (side[0], side[0], tall)
        x, y = (float(v) for v in rng.uniform((0.3, -0.3), (0.65, 0.3)))
        extra.append(PlacementConfig(object=name, position=(x, y), spread=(0.08, 0.08), extents=sizes))
    simulation = cell.simulation.model_copy(update={"placements": (*cell.simulation.placements, *extra)})
    names = (*cell.objects, *(p.object for p in extra))
    return cell.model_copy(update={"objects": names, "simulation": simulation})


def look(row: Row, cell: CellConfig, world: World, label: str) -> None:
    """One look, counted."""
    frames = [RgbdFrame(c, d, k, pose, 0.0, name) for name in (v.name for v in world.cameras)
              for c, d, pose, k in [world.render(name)]]  # fmt: skip
    models = known_models(cell.furniture)
    perception = perception_from_options(known=models, forms=known_forms())
    robot = RobotRegions(cell.robot, cell.cameras).at(REST_Q, cell.robot.gripper_model.opening)
    low, high = np.array(cell.workspace.low), np.array(cell.workspace.high)
    ready = prepared(frames)
    started = time.perf_counter()
    scene = perception.perceive(ready, (*cell.objects, *models))
    row.named_ms.append(1e3 * (time.perf_counter() - started))
    started = time.perf_counter()
    found = UnnamedThings().added(scene, ready, Known(low, high, robot, models)).objects[len(scene.objects) :]
    row.ms.append(1e3 * (time.perf_counter() - started))
    row.looks += 1
    hidden = [n for n in world.object_names if n not in cell.objects]
    surfaces = {name: _surface(world, ready, name) for name in hidden}
    used = set()
    for name, points in surfaces.items():
        if not len(points):
            continue
        row.hidden += 1
        held = np.zeros(len(points), bool)
        volume = 0.0
        for i, o in enumerate(found):
            local = (points - o.position) @ o.world_T_object[:3, :3]
            own = np.all(np.abs(local) < o.extents / 2 + OUTSIDE, axis=1)
            if own.mean() > 0.05:
                used.add(i)
                volume += float(np.prod(o.extents))
            held |= own
        thing = world.objects[name]
        row.inside.append(float(held.mean()))
        if held.mean() < 0.5:
            row.missed += 1
            near = [o.name for o in scene.objects if np.linalg.norm(o.position - world.object_pose(name)[:3, 3]) < 0.12]
            row.notes.append(f"{label}: missed {name} {_mm(thing.extents)}, {len(points)} px, near {near}")
        else:
            row.growth.append(volume / float(np.prod(thing.extents)))
    for i, o in enumerate(found):
        nearest = min((float(np.linalg.norm(world.object_pose(n)[:3, 3] - o.position)) for n in hidden), default=9.0)
        if i not in used and nearest > 0.10:
            row.false += 1
            row.notes.append(f"{label}: false {_mm(o.extents)} at {np.round(o.position, 3).tolist()}; "
                             f"unseen {[u.name for u in scene.unseen]}")  # fmt: skip


def _surface(world: World, frames: Sequence[RgbdFrame], name: str) -> np.ndarray:
    """True points of what cameras see of a thing, of the cameras that see enough of it, shape (n, 3)."""
    found = [np.zeros((0, 3))]
    for frame in frames:
        mask = next((o.mask for o in world.frame_truth(frame.camera).objects if o.name == name), None)
        if mask is None or mask.sum() < SEEN_PIXELS:
            continue
        found.append(frame.cloud[mask & frame.trusted_depth])  # pyright: ignore[reportAttributeAccessIssue]
    return np.concatenate(found)


def _mm(extents: np.ndarray) -> str:
    return " x ".join(f"{1e3 * e:.0f}" for e in extents) + " mm"


def measure(cells: Sequence[str], seeds: int, first: int = 0) -> list[Row]:
    """Rows for each cell, without and with further things."""
    rows = []
    for name in cells:
        cell = load_cell(name)
        plain, more = Row(name), Row(f"{name} + hidden")
        for seed in range(first, first + seeds):
            for row, simulated in ((plain, cell), (more, with_hidden(cell, np.random.default_rng(seed)))):
                try:
                    world = build_world(simulated, seed)
                except StackError as error:  # no room for so many things
                    row.notes.append(f"seed {seed}: {error}")
                    continue
                try:
                    look(row, cell, world, f"seed {seed}")
                finally:
                    world.close()
        rows += [plain, more]
    return rows


def main() -> None:
    """Parse, run, print."""
    parser = argparse.ArgumentParser(description="Unnamed things over seeded simulated cells")
    parser.add_argument("--cells", nargs="+", default=list(builtin_cells()))
    parser.add_argument("--seeds", type=int, default=5, help="seeds per cell")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    rows = measure(args.cells, args.seeds, args.first)
    if args.json:
        print(json.dumps([asdict(row) for row in rows]))
        return
    print(f"{'cell':28}{'looks':>6}{'false':>6}{'hidden':>7}{'missed':>7}{'inside':>8}{'growth':>8}{'ms':>6}{'of':>7}")
    for r in rows:
        inside = f"{np.mean(r.inside):.3f}" if r.inside else "-"
        growth = f"{np.median(r.growth):.2f}" if r.growth else "-"
        times = [f"{np.median(v):.0f}" if v else "-" for v in (r.ms, r.named_ms)]
        print(f"{r.cell:28}{r.looks:>6}{r.false:>6}{r.hidden:>7}{r.missed:>7}{inside:>8}{growth:>8}", end="")
        print(f"{times[0]:>6}{times[1]:>7}")
        for note in r.notes:
            print(f"    {note}")


if __name__ == "__main__":
    main()
