"""Locks of a simulated cell: bolts inside furniture, drawn by a lever or a weight plate. Never in a twin.

A hook on a door's back reaches into the inside. A bolt under the furniture's top stands before it, so that the door
cannot open; the bolt is coupled to what draws it and goes up into the top:

    bolt = travel / way * driver        free when the bolt has gone up by its overlap with the hook

Nothing of it is seen from outside, and nothing but contact holds the door.
"""

import mujoco
import numpy as np

from sim_check.cells.furniture_config import BOARD
from sim_check.cells.simulation_config import LockConfig
from sim_check.furniture.mjcf import DOOR_ARMATURE
from sim_check.furniture.model import FurnitureModel, MovingPart
from sim_check.models.panda_mjcf import COLLISION_GROUP

BOLT_HALF = np.array([0.006, 0.008, 0.010])  # of the bolt in [m]
BOLT_MASS = 0.05  # [kg]; a bolt of a few grams is pushed through the hook
BOLT_TRAVEL = 0.022  # [m]
HOOK_HALF = 0.004  # half thickness of the hook where the bolt presses against it in [m]
_PLAY = 0.0015  # between bolt and hook in [m]
_SLIP = (0.1, 0.005, 0.0001)  # friction of bolt against hook: greased
_STIFF = (0.004, 1.0)


def add_lock(spec: mujoco.MjSpec, lock: LockConfig, furniture: dict[str, FurnitureModel]) -> None:
    """Put bolts and hooks into furniture that is in the scene already.

    Args:
        spec: Scene with the furniture.
        lock: Which doors, and what draws the bolts.
        furniture: What stands in the scene, by name.
    """
    driver = next(p for f in furniture.values() for p in f.parts if p.name == lock.drawn_by)
    for joint in lock.joints:
        owner = next(f for f in furniture.values() if f.part(joint) is not None)
        door = owner.part(joint)
        assert door is not None
        _add_bolt(spec, owner, door, driver, lock.free_at)


def _add_bolt(spec: mujoco.MjSpec, owner: FurnitureModel, door: MovingPart, driver: MovingPart, free_at: float) -> None:
    panel = door.boards[0].solid
    back = door.anchor[0] + panel.position[0] + panel.half[0]
    ceiling = owner.extents[2] / 2 - BOARD
    # The free edge of the closed door is where its handle is.
    assert door.handle is not None
    side = np.sign(door.handle.centre[1] - panel.position[1])
    edge = door.anchor[1] + panel.position[1] + side * panel.half[1]
    bolt_top = ceiling - 0.001
    hook_top = bolt_top - 2 * BOLT_HALF[2] + free_at * BOLT_TRAVEL
    hook_low = hook_top - 0.024
    if door.kind == "hinge":
        # Opening takes the hook to -x: the bolt stands between it and the door.
        bolt = np.array([back + 0.004 + BOLT_HALF[0], edge - side * 0.03, bolt_top - BOLT_HALF[2]])
        hook_x = bolt[0] + BOLT_HALF[0] + _PLAY + HOOK_HALF
        hook = np.array([hook_x, bolt[1], (hook_top + hook_low) / 2])
        half = np.array([HOOK_HALF, 0.012, (hook_top - hook_low) / 2])
    else:
        # Opening takes the hook along the door's axis: the bolt stands on that side of it.
        ahead = float(door.axis[1])
        inner = owner.compartments[0]
        hook_y = (inner.low if ahead > 0 else inner.high)[1] + ahead * 0.03
        hook = np.array([back + 0.014, hook_y, (hook_top + hook_low) / 2])
        half = np.array([0.014, HOOK_HALF, (hook_top - hook_low) / 2])
        bolt = np.array([back + 0.016, hook_y + ahead * (HOOK_HALF + _PLAY + BOLT_HALF[1]), bolt_top - BOLT_HALF[2]])
    moving = spec.body(door.name)
    _add_hidden(moving, f"{door.name}_hook", hook - door.anchor, half)
    if door.kind == "hinge":
        _add_hidden(
            moving,
            f"{door.name}_hook_arm",
            np.array([(back + hook[0]) / 2, hook[1], hook_low - 0.003]) - door.anchor,
            np.array([(hook[0] - back) / 2 + HOOK_HALF, 0.012, 0.003]),
        )
    name = f"{door.name}_bolt"
    body = spec.body(owner.name).add_body(name=name, pos=bolt, gravcomp=1.0)
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0.0, 0.0, 1.0],
        range=[-0.002, BOLT_TRAVEL + 0.002],
        damping=[2.0, 0.0, 0.0],
        armature=DOOR_ARMATURE,
    )
    _add_hidden(body, name, np.zeros(3), BOLT_HALF, mass=BOLT_MASS)
    # The bolt slides in the top's board.
    spec.add_exclude(bodyname1=owner.name, bodyname2=name)
    coupling = spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_JOINT, name1=name, name2=driver.name)
    coupling.data[:5] = [0.0, BOLT_TRAVEL / driver.opened, 0.0, 0.0, 0.0]
    coupling.solref = _STIFF


def _add_hidden(body: mujoco.MjsBody, name: str, position: np.ndarray, half: np.ndarray, mass: float = 0.0) -> None:
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=position,
        size=half,
        mass=mass,
        group=COLLISION_GROUP,
        friction=_SLIP,
        priority=1,
        solref=_STIFF,
        rgba=[0.9, 0.1, 0.6, 1.0],
    )
