"""Looking before acting: at space on the way that nobody saw, with the wrist camera, by motions like any other."""

from collections.abc import Callable

import numpy as np

from control.planners.looking import WristCamera
from control.tasks.failure import FailureCause
from control.twin_model import TwinModel
from perception.estimates import SceneEstimate
from replan.run.motion_finder import BlindWay, JudgedMotion, MotionFinder
from replan.run.motion_player import MotionPlayer
from replan.run.session import RunSession
from sim_check.cells.loading import CellConfig

MOST_LOOKS = 2  # along the way of one motion
UNSEEN_CHECKS = ("unseen_volume", "unseen_overhead")


class FirstLooks:
    """Decides where to look first, and does.

    Args:
        session: The run.
        finder, player: Of its motions.
        look_again: A fresh look for the same names, united with the one before.
    """

    def __init__(
        self,
        session: RunSession,
        finder: MotionFinder,
        player: MotionPlayer,
        look_again: Callable[[], SceneEstimate] | None,
    ) -> None:
        self._session, self._finder, self._player = session, finder, player
        self._look_again = look_again
        self._safety = session.cell.safety_limits()
        self._camera = wrist_camera(session.cell)

    def along(self, found: JudgedMotion | FailureCause) -> SceneEstimate | None:
        """Look at what nobody saw of the way that was judged last, where that matters.

        Args:
            found: What came of the search: a motion that passed, or why there is none.

        Returns:
            What is seen then; None where no look is worth it or possible, and the arm has not moved.

        Raises:
            PerceptionError, RobotGoneError, StoppedError: The run cannot go on.
        """
        blind = self._finder.blind
        if blind is None or not self._matters(found, blind):
            return None
        overhead = isinstance(found, FailureCause) and found.check == "unseen_overhead"
        share = blind.unseen.overhead if overhead else blind.unseen.hidden
        points = blind.unseen.above if overhead else blind.unseen.points
        return self._look(blind.twin, points, f"{share:.0%} of the way was not seen", share=share)

    def _matters(self, found: JudgedMotion | FailureCause, blind: BlindWay) -> bool:
        if isinstance(found, FailureCause):
            return found.kind == "unsafe" and found.check in UNSEEN_CHECKS
        return self._safety.unseen == "avoid" and blind.unseen.hidden >= self._safety.look_first

    def _look(self, twin: TwinModel, points: np.ndarray, why: str, **more: object) -> SceneEstimate | None:
        # What is in the hand would move with the look.
        if self._camera is None or self._look_again is None or twin.held is not None:
            return None
        self._session.say(f"looks first: {why}")
        motion = self._finder.find_look(twin, points, self._camera)
        cause = motion if isinstance(motion, FailureCause) else None
        self._session.episode.log("looks_first", why=why, middle=points.mean(axis=0), cause=cause, **more)
        if isinstance(motion, FailureCause):
            self._session.say(f"cannot look there: {motion.message}")
            return None
        self._player.play(motion)
        return self._look_again()


def wrist_camera(cell: CellConfig) -> WristCamera | None:
    """The first camera of a cell that rides on the hand, as a search for views needs it; None where there is none."""
    for camera in cell.cameras:
        if camera.mounting == "wrist":
            lens = camera.intrinsics
            size, focal, centre = (lens.width, lens.height), (lens.fx, lens.fy), (lens.cx, lens.cy)
            return WristCamera(camera.mount_T_camera, size, focal, centre)
    return None
