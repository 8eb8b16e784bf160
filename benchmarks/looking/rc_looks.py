"""What one look through all cameras of a cell makes of everything in it, closed and with the doors opened.

Each cell is looked at as it is built, then with every door and lever at each of some fractions (what would stand in a
door's way is put aside first), so that what was hidden shows. With `--stacked` one thing is put on another, turned and
off the middle at random, and what is said to be on what counts too. The perception under test sees frames and the
furniture's sizes in the cell file; this script, a scorer, reads the truth. Besides what the cell lists it asks for a
thing that is in none of them.

    python -m benchmarks.looking.rc_looks --seeds 5
    python -m benchmarks.looking.rc_looks --cells kitchen-explore --seeds 20 --fractions --worst 10
    python -m benchmarks.looking.rc_looks --cells cubes-color --seeds 10 --stacked red_cube red_crate
"""

import argparse
import sys
import time
from dataclasses import dataclass, field

import mujoco
import numpy as np

from benchmarks.looking.pose_error import true_object
from perception.estimates import ObjectEstimate
from perception.evaluation.metrics import compare
from perception.frames import RgbdFrame
from perception.pipeline import Perception, perception_from_options
from planning.language.relations import Relation, find_relations
from sim_check.cells.loading import load_cell
from sim_check.furniture.known_models import known_models
from sim_check.furniture.mjcf import set_fractions
from sim_check.models.known_forms import known_forms
from sim_check.world.world import World, build_world

CELLS = (
    "cabinet-open",
    "cabinet-closed",
    "cabinet-blocked",
    "cabinet-locked",
    "cubes-color",
    "cubes-blocked",
    "kitchen-explore",
    "composite-explore",
)
ABSENT = "green_cube"
SHOWS = 150  # [px]; a thing that shows less in every camera need not be seen
# Where things are put, (x, y, yaw) in [m] and [rad], before doors that they bar are opened.
ASIDE = {"kettle": (0.36, -0.12, 0.3), "red_bar": (0.36, 0.22, 0.6)}
STACKED = "stacked"
OFF_MIDDLE = 0.015  # how far off the middle of what carries it a stacked thing stands at most, in [m]


@dataclass
class Row:
    """One thing in one state of one cell.

    Attributes:
        showed: How often it showed at least `SHOWS` pixels in some camera.
        seen: How often it was seen then.
        glimpsed: How often it was seen though it showed less, but something.
        invented: How often it was reported though it showed nowhere.
        position, yaw, extents: Errors in [mm], [deg], [mm] of what was seen.
        joints: Errors of its joints in [deg] or [mm].
        colours: Colours it was said to have.
        on: Of one thing on another: how often that was said.
    """

    showed: int = 0
    seen: int = 0
    glimpsed: int = 0
    invented: int = 0
    position: list[float] = field(default_factory=list)
    yaw: list[float] = field(default_factory=list)
    extents: list[float] = field(default_factory=list)
    joints: list[float] = field(default_factory=list)
    colours: dict[str, int] = field(default_factory=dict)
    on: int = 0


def put(world: World, name: str, x: float, y: float, bottom: float, yaw: float) -> None:
    """Stand a thing at (x, y) on a surface of height `bottom`, all in [m], turned by `yaw` [rad]."""
    centre = bottom + float(world.objects[name].extents[2]) / 2
    first = int(world.model.jnt_qposadr[world.model.body(name).jntadr[0]])
    world.data.qpos[first : first + 7] = [x, y, centre, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]


def stack(world: World, upper: str, lower: str, rng: np.random.Generator) -> None:
    """Stand one thing on another, at any yaw and up to `OFF_MIDDLE` off its middle."""
    carrier, tall = world.object_pose(lower)[:3, 3], float(world.objects[lower].extents[2])
    yaw, way, off = rng.uniform(-np.pi, np.pi), rng.uniform(-np.pi, np.pi), rng.uniform(0.0, OFF_MIDDLE)
    x, y = carrier[:2] + off * np.array([np.cos(way), np.sin(way)])
    put(world, upper, float(x), float(y), float(carrier[2]) + tall / 2, float(yaw))
    mujoco.mj_forward(world.model, world.data)


def open_doors(world: World, fraction: float) -> None:
    """Put barring things aside and every joint without a spring to a fraction, 0 closed .. 1 open."""
    for name, (x, y, yaw) in ASIDE.items():
        if name in world.objects:
            put(world, name, x, y, 0.0, yaw)
    for thing in world.furniture.values():
        drawn = {p.name: fraction for p in thing.parts if p.stiffness == 0}
        set_fractions(world.model, world.data.qpos, thing, drawn)
    mujoco.mj_forward(world.model, world.data)


def shown_pixels(world: World) -> dict[str, int]:
    """Most pixels that each thing shows in one camera, by name; what shows nowhere is left out."""
    most: dict[str, int] = {}
    for camera in world.cameras:
        for thing in world.frame_truth(camera.name).objects:
            assert thing.mask is not None
            most[thing.name] = max(most.get(thing.name, 0), int(thing.mask.sum()))
    return most


def joint_errors(estimate: ObjectEstimate, world: World) -> list[float]:
    """Of each joint in [deg] or [mm]."""
    errors = []
    for part in world.furniture[estimate.name].parts:
        unit = part.opened * (180 / np.pi if part.kind == "hinge" else 1e3)
        errors.append(abs(estimate.joint_fractions[part.name] - world.joint_fraction(part.name)) * unit)
    return errors


def score(estimate: ObjectEstimate, world: World, row: Row) -> str:
    """Add one estimate's errors to a row; the same in words."""
    if estimate.name in world.furniture:
        off = world.object_pose(estimate.name)[:2, 3] - estimate.position[:2]
        turn = world.object_pose(estimate.name)[:3, :3].T @ estimate.world_T_object[:3, :3]
        row.position.append(1e3 * float(np.linalg.norm(off)))
        yaw = abs(np.degrees(np.arctan2(turn[1, 0], turn[0, 0])))
        if abs(estimate.extents[0] - estimate.extents[1]) < 1e-6:  # looks the same after a quarter turn
            yaw = abs((yaw + 45.0) % 90.0 - 45.0)
        row.yaw.append(float(yaw))
        row.joints += joint_errors(estimate, world)
        joints = ", ".join(f"{e:.1f}" for e in joint_errors(estimate, world))
        return f"position {row.position[-1]:.1f} mm, yaw {yaw:.1f} deg, joints {joints}"
    error = compare(estimate, true_object(world, estimate.name))
    yaw = error.yaw_deg
    if world.objects[estimate.name].noun == "kettle":  # its spout tells front from back
        true = world.object_pose(estimate.name)
        turn = true[:3, :3].T @ estimate.world_T_object[:3, :3]
        yaw = abs(float(np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))))
    row.position.append(error.position_mm)
    row.extents.append(error.extents_mm)
    if np.isfinite(yaw):
        row.yaw.append(yaw)
    colour = str(getattr(estimate, "colour", None))
    row.colours[colour] = row.colours.get(colour, 0) + 1
    return (
        f"position {error.position_mm:.1f} mm, yaw {yaw:.1f} deg, extents {error.extents_mm:.1f} mm, {estimate.shape}"
    )


def look(
    world: World,
    perception: Perception,
    rows: dict[str, Row],
    lines: list[tuple[float, str]],
    label: str,
    stacked: tuple[str, str] | None = None,
) -> float:
    """One look at a world, scored into `rows` by name and `lines` by position error; CPU seconds.

    Args:
        world: What to look at.
        perception: The perception under test.
        rows: Scores by name, which are added to.
        lines: Position errors with words, which are added to.
        label: What the lines begin with.
        stacked: A thing and what carries it, or None.
    """
    frames = []
    for camera in world.cameras:
        colour, depth, pose, lens = world.render(camera.name)
        frames.append(RgbdFrame(colour, depth, lens, pose, 0.0, camera.name))
    shown = shown_pixels(world)
    started = time.process_time()
    scene = perception.perceive(frames, (*world.object_names, ABSENT, *world.furniture_names))
    seconds = time.process_time() - started
    for name in (*world.object_names, ABSENT, *world.furniture_names):
        row, estimate = rows.setdefault(name, Row()), scene.get(name)
        pixels = shown.get(name, 0)
        row.showed += pixels >= SHOWS
        if estimate is None:
            if pixels >= SHOWS:
                why = next(u.reason for u in scene.unseen if u.name == name)
                lines.append((np.inf, f"{label}: {name} not seen ({pixels} px): {why}"))
        elif pixels == 0:
            row.invented += 1
            lines.append((np.inf, f"{label}: {name} invented at {np.round(estimate.position, 3)}"))
        else:
            row.seen += pixels >= SHOWS
            row.glimpsed += pixels < SHOWS
            words = score(estimate, world, row)
            lines.append((row.position[-1], f"{label}: {name} ({pixels} px) {words}"))
    if stacked is not None:
        upper, lower = stacked
        rows[upper].on += Relation("on", upper, lower) in find_relations(scene)
    return seconds


def main() -> None:
    """Parse, run, print."""
    parser = argparse.ArgumentParser(description="One look at everything in the cells, closed and opened")
    parser.add_argument("--cells", nargs="+", default=list(CELLS))
    parser.add_argument("--seeds", type=int, default=5, help="seeds per cell")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--fractions", nargs="*", type=float, default=[0.75, 0.95], help="of the opened doors")
    parser.add_argument("--stacked", nargs=2, metavar=("UPPER", "LOWER"), help="also with one thing put on another")
    parser.add_argument("--detector", default="default")
    parser.add_argument("--segmenter", default="default")
    parser.add_argument("--worst", type=int, default=0, help="also list the worst estimates")
    args = parser.parse_args()
    table: dict[tuple[str, str], dict[str, Row]] = {}
    lines: list[tuple[float, str]] = []
    seconds: list[float] = []
    looker = ""
    for cell_name in args.cells:
        cell = load_cell(cell_name)
        known = known_models(cell.furniture)
        perception = perception_from_options(args.detector, args.segmenter, known=known, forms=known_forms())
        looker = perception.name
        for seed in range(args.first_seed, args.first_seed + args.seeds):
            world = build_world(cell, seed)
            states: list[tuple[str, float | None]] = [("start", None)]
            states += [(f"{f:g}", f) for f in args.fractions if world.furniture]
            for state, fraction in states:
                if fraction is not None:
                    open_doors(world, fraction)
                rows = table.setdefault((cell_name, state), {})
                seconds.append(look(world, perception, rows, lines, f"{cell_name} seed {seed} {state}"))
            if args.stacked and all(name in world.objects for name in args.stacked):
                stack(world, args.stacked[0], args.stacked[1], np.random.default_rng(seed))
                rows = table.setdefault((cell_name, STACKED), {})
                label = f"{cell_name} seed {seed} {STACKED}"
                seconds.append(look(world, perception, rows, lines, label, (args.stacked[0], args.stacked[1])))
            world.close()
            print(".", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    print(f"{looker}; {np.median(seconds):.2f} s CPU a look (median)")
    print(
        f"{'cell':18}{'doors':8}{'thing':16}{'seen':>7}{'glimpsed':>9}{'invented':>9}"
        f"{'position mm':>15}{'yaw deg':>14}{'sides mm':>14}{'joints':>13}  colours"
    )
    for (cell_name, state), rows in table.items():
        for name, row in rows.items():
            columns = [
                f"{np.median(v):.1f} / {max(v):.1f}" if v else ""
                for v in (row.position, row.yaw, row.extents, row.joints)
            ]
            counts = f"{row.seen}/{row.showed}"
            colours = ", ".join(f"{c} {n}" for c, n in row.colours.items())
            print(
                f"{cell_name:18}{state:8}{name:16}{counts:>7}{row.glimpsed:>9}{row.invented:>9}"
                f"{columns[0]:>15}{columns[1]:>14}{columns[2]:>14}{columns[3]:>13}  {colours}"
            )
        if state == STACKED:
            upper, lower = args.stacked
            print(f"{cell_name:18}{state:8}{upper} is on {lower}: said {rows[upper].on} of {args.seeds} times")
    print("median / worst; joints in degrees or mm")
    for _, line in sorted(lines, reverse=True)[: args.worst]:
        print(line)


if __name__ == "__main__":
    main()
