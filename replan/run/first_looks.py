"""Looking before acting, with the wrist camera, by motions like any other.

A run looks at space on the way that nobody saw, and at things that are not known well enough for what is to be done
with them.
"""

from collections import Counter
from collections.abc import Callable, Collection

import numpy as np
from numpy.typing import NDArray

from control.errors import StackError
from control.planners.looking import WristCamera
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec
from control.twin_model import TwinModel
from perception.estimates import ObjectEstimate, SceneEstimate
from planning.loop.closer_looks import doubted_things
from replan.run.motion_finder import BlindWay, JudgedMotion, MotionFinder
from replan.run.motion_player import MotionPlayer
from replan.run.session import RunSession
from sim_check.cells.loading import CellConfig

LookAgain = Callable[[Collection[str]], SceneEstimate]
MOST_LOOKS = 2  # before one motion, at its way and at things each
MOST_CLOSER = 2  # at one thing as long as it stays doubted, each before another motion
UNSEEN_CHECKS = ("unseen_volume", "unseen_overhead")


class FirstLooks:
    """Decides where to look first, and does.

    Args:
        session: The run.
        finder, player: Of its motions.
        look_again: A fresh look for the same names, united with the one before, but for the names that it is given.
    """

    def __init__(
        self,
        session: RunSession,
        finder: MotionFinder,
        player: MotionPlayer,
        look_again: LookAgain | None,
    ) -> None:
        self._session, self._finder, self._player = session, finder, player
        self._look_again = look_again
        self._safety = session.cell.safety_limits()
        self._camera = wrist_camera(session.cell)
        self._closer: Counter[str] = Counter()

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

    def at_things(self, spec: RewardSpec, scene: SceneEstimate) -> SceneEstimate:
        """Look closer at things that a motion would handle without knowing them well enough, a few times at most.

        Args:
            spec: Of the motion.
            scene: What was seen last.

        Returns:
            What is known then; the scene itself where nothing is doubted or no look is possible.

        Raises:
            PerceptionError, RobotGoneError, StoppedError: The run cannot go on.
        """
        gripper = self._session.cell.robot.gripper_model
        start = self._player.start()
        tried: set[str] = set()
        for _ in range(MOST_LOOKS):
            doubted = doubted_things(spec, scene, gripper, self._safety, start.held)
            for name in self._closer.keys() - {d.name for d in doubted}:
                del self._closer[name]
            few = (d for d in doubted if d.name not in tried and self._closer[d.name] < MOST_CLOSER)
            thing = next(few, None)
            if thing is None:
                return scene
            tried.add(thing.name)
            self._closer[thing.name] += 1
            estimate = scene.get(thing.name)
            assert estimate is not None  # it was doubted
            try:
                twin = self._finder.twin_of(scene, self._player.start())
            except StackError:
                return scene  # the search says so
            latest = self._look(twin, surface_points(estimate), f"at {thing.name}, as {thing.why}", thing.name)
            if latest is None:
                return scene
            scene = latest
        return scene

    def _matters(self, found: JudgedMotion | FailureCause, blind: BlindWay) -> bool:
        if isinstance(found, FailureCause):
            return found.kind == "unsafe" and found.check in UNSEEN_CHECKS
        return self._safety.unseen == "avoid" and blind.unseen.hidden >= self._safety.look_first

    def _look(
        self, twin: TwinModel, points: np.ndarray, why: str, thing: str | None = None, **more: object
    ) -> SceneEstimate | None:
        # What is in the hand would move with the look.
        if self._camera is None or self._look_again is None or twin.held is not None:
            return None
        self._session.say(f"looks closer {why}" if thing else f"looks first: {why}")
        motion = self._finder.find_look(twin, points, self._camera, closer=thing is not None)
        cause = motion if isinstance(motion, FailureCause) else None
        self._session.episode.log("looks_first", why=why, thing=thing, middle=points.mean(axis=0), cause=cause, **more)
        if isinstance(motion, FailureCause):
            self._session.say(f"cannot look there: {motion.message}")
            return None
        self._player.play(motion)
        return self._look_again((thing,) if thing else ())


def surface_points(thing: ObjectEstimate) -> NDArray[np.float64]:
    """Corners and middles of edges and faces of a thing's box in the world in [m], shape (26, 3)."""
    grid = np.stack(np.meshgrid(*[(-0.5, 0.0, 0.5)] * 3, indexing="ij"), -1).reshape(-1, 3)
    local = grid[np.any(grid != 0.0, axis=1)] * thing.extents
    return local @ thing.world_T_object[:3, :3].T + thing.position


def wrist_camera(cell: CellConfig) -> WristCamera | None:
    """The first camera of a cell that rides on the hand, as a search for views needs it; None where there is none."""
    for camera in cell.cameras:
        if camera.mounting == "wrist":
            lens = camera.intrinsics
            size, focal, centre = (lens.width, lens.height), (lens.fx, lens.fy), (lens.cx, lens.cy)
            return WristCamera(camera.mount_T_camera, size, focal, centre)
    return None
