"""Which space the cameras of a run have looked into, look by look."""

from collections.abc import Sequence

import numpy as np

from perception.estimates import SceneEstimate
from perception.frames import RgbdFrame
from perception.seen_space import FREE, OCCUPIED, SeenSpace
from perception.unexplained.carving import estimate_solids, filled, look_into
from sim_check.cells.loading import CellConfig
from sim_check.models.robot_region import RobotRegions

# How far the box is larger than the hand's workspace on all four sides in [m]: elbows go there.
BEYOND = 0.1
NEAR = 0.01  # [m]: half a voxel, as a voxel is judged by its middle


class LookedInto:
    """Keeps what the last look saw, so that a further one of the same world can be united with it.

    Args:
        cell: Its workspace, its robot and its cameras.
    """

    def __init__(self, cell: CellConfig) -> None:
        beyond = np.array([BEYOND, BEYOND, 0.0])
        low, high = (np.array(corner) for corner in (cell.workspace.low, cell.workspace.high))
        self._nothing = SeenSpace.unseen(low - beyond, high + beyond)
        self._robot = RobotRegions(cell.robot, cell.cameras)
        self._furniture = frozenset(cell.furniture)
        self._last = self._nothing

    def after(
        self,
        frames: Sequence[RgbdFrame],
        scene: SceneEstimate,
        q: np.ndarray,
        gripper_width: float,
        unchanged: bool = False,
    ) -> SeenSpace:
        """What is seen now.

        Args:
            frames: Of one moment.
            scene: What was perceived in them. Furniture has an inside that is not filled; all else counts as solid.
            q: Arm joints at that moment in [rad], shape (7,): where the robot is, nothing else can be.
            gripper_width: Distance between the pads in [m].
            unchanged: Whether nothing in the world has moved since the last look, the robot apart.
        """
        seen = look_into(self._nothing, frames)
        seen = filled(seen, self._robot.at(q, gripper_width).solids, FREE, NEAR)
        seen = filled(seen, estimate_solids(o for o in scene.objects if o.name not in self._furniture), OCCUPIED)
        self._last = self._last.united(seen) if unchanged else seen
        return self._last
