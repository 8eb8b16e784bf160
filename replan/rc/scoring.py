"""Whether a goal was truly reached, and what was harmed on the way.

Independent of the predicates that runs judge themselves by: true poses, sizes and speeds of the simulated cell only.
Every scorer says why the goal is not reached, or "" where it is.
"""

import numpy as np

from perception.ground_truth import CellTruth, StandingThing
from replan.rc.ending import Ending
from sim_check.furniture.model import FurnitureModel

CONTACT = 0.005  # [m] between a thing's lowest point and what it rests on, at most
UPRIGHT = np.cos(np.radians(10.0))
STILL = 0.005, 0.05  # speeds in [m/s] and [rad/s] below which a thing is at rest
FOUND_WITHIN = 0.03  # [m] between the last estimate of a thing and the truth
DOOR_OPEN = 0.6  # [rad] that a door must be open for what is behind it to count as found
SHOWN_PIXELS = 20  # [px] in one camera
SLID_OPEN = 0.8  # share of a sliding door's way
MOVED = 0.02  # [m] that a thing may be moved that the task has no need of
TIPPED = np.cos(np.radians(20.0))


def lies_in(ending: Ending, name: str, furniture: str) -> str:
    """Its centre is inside, it rests on the inside's floor, one face up."""
    thing, shell = ending.after.things[name], ending.after.things[furniture]
    if not _centre_inside(thing, shell, ending.furniture[furniture]):
        return f"{name} is not inside {furniture}"
    floors = [c.low[2] for c in ending.furniture[furniture].compartments]
    bottom = _lowest(thing) - shell.world_T_object[2, 3]
    gap = min(abs(bottom - floor) for floor in floors)
    if gap > CONTACT:
        return f"{name} does not rest on the floor of {furniture}: {1e3 * gap:.0f} mm off it"
    return _unsteady(thing)


def rests_on(ending: Ending, name: str, below: str) -> str:
    """Its centre is above the other thing, its lowest point on the other's top, one face up."""
    thing, base = ending.after.things[name], ending.after.things[below]
    offset = (np.linalg.inv(base.world_T_object) @ thing.world_T_object)[:3, 3]
    if np.any(np.abs(offset[:2]) > base.extents[:2] / 2):
        return f"{name} is not above {below}"
    gap = _lowest(thing) - _highest(base)
    if abs(gap) > CONTACT:
        return f"{name} does not rest on {below}: {1e3 * gap:.0f} mm off it"
    return _unsteady(thing)


def found(ending: Ending, name: str) -> str:
    """The run says so, the thing can truly be seen, and it is where the run believes it to be."""
    if not ending.claimed:
        return f"the run does not say that it found {name}"
    thing = ending.after.things[name]
    for owner, model in ending.furniture.items():
        if not _centre_inside(thing, ending.after.things[owner], model):
            continue
        doors = {joint for c in model.compartments for joint in c.joints}
        widest = max((ending.after.joints[j].position for j in doors), default=np.inf)
        if widest < DOOR_OPEN:
            return f"{name} is in {owner}, whose door is open by {widest:.2f} rad only"
    if ending.shown.get(name, 0) < SHOWN_PIXELS:
        return f"no camera truly shows {name}"
    if name not in ending.estimates:
        return f"the run has no estimate of where {name} is"
    off = float(np.linalg.norm(ending.estimates[name] - thing.world_T_object[:3, 3]))
    return f"{name} is {1e3 * off:.0f} mm from where the run believes it" if off > FOUND_WITHIN else ""


def opened(ending: Ending, joint: str) -> str:
    """The joint is open by `SLID_OPEN`."""
    fraction = ending.after.joints[joint].fraction
    return "" if fraction >= SLID_OPEN else f"{joint} is open by {100 * fraction:.0f} % only"


def harm(before: CellTruth, after: CellTruth, needed: tuple[str, ...]) -> tuple[str, ...]:
    """What came to harm: things that are not needed and were moved or tipped, and whatever fell off the table."""
    harmed = []
    for name, thing in after.things.items():
        if thing.fixed:
            continue
        then = before.things[name].world_T_object
        moved = float(np.linalg.norm(thing.world_T_object[:3, 3] - then[:3, 3]))
        if thing.world_T_object[2, 3] < 0.0:  # the table's top is at z = 0
            harmed.append(f"{name} fell off the table")
        elif name in needed:
            continue
        elif then[:3, 2] @ thing.world_T_object[:3, 2] < TIPPED:
            harmed.append(f"{name} was tipped")
        elif moved > MOVED:
            harmed.append(f"{name} was moved by {1e3 * moved:.0f} mm")
    return tuple(harmed)


def _corners(thing: StandingThing) -> np.ndarray:
    """Corners of its box in the world in [m], shape (8, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return signs * thing.extents / 2 @ thing.world_T_object[:3, :3].T + thing.world_T_object[:3, 3]


def _lowest(thing: StandingThing) -> float:
    return float(_corners(thing)[:, 2].min())


def _highest(thing: StandingThing) -> float:
    return float(_corners(thing)[:, 2].max())


def _centre_inside(thing: StandingThing, shell: StandingThing, model: FurnitureModel) -> bool:
    centre = (np.linalg.inv(shell.world_T_object) @ thing.world_T_object)[:3, 3]
    return any(bool(np.all((centre > c.low) & (centre < c.high))) for c in model.compartments)


def _unsteady(thing: StandingThing) -> str:
    if np.abs(thing.world_T_object[2, :3]).max() < UPRIGHT:
        return f"{thing.name} stands on an edge"
    speed, turning = np.linalg.norm(thing.velocity[:3]), np.linalg.norm(thing.velocity[3:])
    return f"{thing.name} still moves" if speed > STILL[0] or turning > STILL[1] else ""
