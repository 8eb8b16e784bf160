"""What can be told before any candidate is made, so that a hopeless search costs no minute.

Heights out of reach, and arms that start inside something.
"""

import mujoco
import numpy as np

from control.grasping.grasps import PITCHES, tcp_frame
from control.path_planning.planning_context import LIMIT_MARGIN
from control.robot.kinematics import ArmKinematics
from control.tasks.failure import FailureCause
from control.tasks.subtasks import Subtask, posed_objects
from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY, TwinModel

# Distances from the arm's axis in [m] at which a thing might be held up, with the hand pitched as for grasps. The arm
# turns about that axis, so one direction stands for all.
DISTANCES = np.arange(0.20, 0.85, 0.08)
TOUCH = 1e-4  # [m] of overlap from which a contact counts


def too_high(twin: TwinModel, task: Subtask, arm: ArmKinematics) -> FailureCause | None:
    """A lift to a height at which the arm can hold nothing, whichever way it turns.

    Args:
        twin: For the object and where the arm stands.
        task: Anything but a lift is never too high.
        arm: Solves inverse kinematics in the frame of the arm's base.
    """
    if task.manipulation != "lift" or task.subject is None:
        return None
    data = twin.start()
    thing, height = posed_objects(twin, data)[task.subject], task.amount
    # Held by its lower end, its centre is above the hand by half of its longest side.
    least = height - float(np.max(thing.extents)) / 2
    base = data.body(ARM_BODIES[0]).xpos[2]
    targets = []
    handled = next(o.handle for o in twin.objects if o.name == task.subject) is not None
    for pitch in [*PITCHES, *([0.0] if handled else [])]:  # handles are taken level as well
        approach = np.array([np.cos(pitch), 0.0, -np.sin(pitch)])
        for distance in DISTANCES:
            pose = np.eye(4)
            pose[:3, :3] = tcp_frame(approach, np.array([0.0, 1.0, 0.0]))
            pose[:3, 3] = distance, 0.0, least - base
            targets.append(pose)
    found = arm.solve_ik(np.array(targets), per_pose=1, min_margin=LIMIT_MARGIN)
    if len(found.q):
        return None
    return FailureCause(
        "no_candidate",
        task.subject,
        f"{height:.2f} m is out of reach: the arm cannot hold '{task.subject}' as high as that in any posture; ask for "
        "less",
        evidence={"height": height, "postures": len(targets)},
    )


def start_contact(twin: TwinModel, safety_check: str = "arm_clearance") -> FailureCause | None:
    """The deepest contact of the robot at the start with anything but what it holds, as the cause of a failure.

    An arm that starts too close to something is given a way out by the search; this is for when it found none.

    Args:
        twin: As the search began.
        safety_check: Check that the cause names.
    """
    model, data = twin.model, twin.start()
    robot = {model.body(n).id for n in (*ARM_BODIES[1:], HAND_BODY, *FINGER_BODIES)}
    deepest, outside, link = TOUCH, -1, -1
    for contact in data.contact[: data.ncon]:
        bodies = [int(model.geom_bodyid[g]) for g in contact.geom]
        touched = [b for b in bodies if b not in robot]
        if len(touched) == 1 and model.body(touched[0]).name != twin.held and -contact.dist > deepest:
            deepest, outside = -float(contact.dist), touched[0]
            link = next(b for b in bodies if b in robot)
    if outside < 0:
        return None
    name = _named(model, outside)
    return FailureCause(
        "unsafe",
        name,
        f"the arm starts {deepest * 1e3:.0f} mm inside '{name}' with '{model.body(link).name}' and no way out was "
        f"found: guide it clear of '{name}' by hand, then look again",
        bodies=(name,),
        check=safety_check,
        evidence={"depth": deepest, "link": model.body(link).name},
    )


def _named(model: mujoco.MjModel, body: int) -> str:
    while body and not model.body(body).name:
        body = int(model.body_parentid[body])
    return model.body(body).name
