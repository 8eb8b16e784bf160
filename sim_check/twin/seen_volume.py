"""Space that a look has seen, as a twin has it: what stands there is known, and what could stand elsewhere is hidden.

Space is free below a voxel where at least `CLEARED` voxels of the column under it were seen to be free. A voxel that
was not seen is overhead where space is free below it and `REACH` voxels to all sides, as things overhang their feet;
else it is hidden.
"""

import mujoco
import numpy as np
from scipy import ndimage

from control.seen_volume import CLEAR, FILLED, HIDDEN, OVERHEAD, SeenVolume
from perception.seen_space import FREE, OCCUPIED, UNSEEN, SeenSpace
from perception.unexplained.carving import below, filled
from sim_check.models.robot_region import solids_of

CLEARED = 2
REACH = 2
# What is within this of a solid counts as in it, in [m]: half a voxel, as a voxel is judged by its middle.
NEAR = 0.01


def seen_volume(seen: SeenSpace, model: mujoco.MjModel, data: mujoco.MjData, support_height: float) -> SeenVolume:
    """What was seen, with everything that stands in a twin known.

    Args:
        seen: By the cameras.
        model, data: Of the twin, with up-to-date kinematics.
        support_height: Of the table in the world in [m].
    """
    robot, others = solids_of(model, data)
    space = filled(filled(seen, robot, FREE, NEAR), others, OCCUPIED, NEAR)
    space = below(space, support_height)
    free = np.cumsum(space.state == FREE, axis=2) >= CLEARED
    under = np.zeros_like(free)
    under[:, :, 1:] = free[:, :, :-1]
    # Beyond the box's sides nobody looks, so nothing is free there.
    under = ndimage.minimum_filter(under.view(np.int8), size=(2 * REACH + 1, 2 * REACH + 1, 1), mode="constant") > 0
    state = np.full(space.state.shape, CLEAR, np.int8)
    state[space.state == OCCUPIED] = FILLED
    unseen = space.state == UNSEEN
    state[unseen] = np.where(under[unseen], OVERHEAD, HIDDEN)
    return SeenVolume(space.low, space.step, state)
