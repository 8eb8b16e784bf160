"""Hands of a run: from a reward spec to a motion that was judged in the twin and then played by the robot."""

import numpy as np

from control.robot.dynamics import RobotModel
from control.robot.limits import REST_Q
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec
from perception.estimates import SceneEstimate
from planning.baselines.rehearsal import Rehearsal
from planning.loop.interfaces import AttemptResult
from replan.run.first_looks import MOST_LOOKS, FirstLooks, LookAgain
from replan.run.motion_finder import MotionFinder
from replan.run.motion_player import MotionPlayer, failed
from replan.run.session import RunSession
from sim_check.twin.predicted_scene import predicted_scene


class TwinCheckedExecutor:
    """Plans in the twin, judges there, and sends the robot nothing that did not pass.

    Args:
        session: The run.
        seed: Of motion search and of the perturbed twins.
        filming: Whether to take pictures while the robot moves.
        go_on_after_stall: As for `replan.run.motion_player.MotionPlayer`.
        look_again: A fresh look for the same names after nothing but the arm has moved; None where nobody looks first.
    """

    def __init__(
        self,
        session: RunSession,
        seed: int,
        filming: bool,
        go_on_after_stall: bool = False,
        look_again: LookAgain | None = None,
    ) -> None:
        self._session = session
        self._robot = RobotModel.panda(gripper=session.cell.robot.gripper_model)
        self._finder = MotionFinder(session, seed, self._robot)
        self._player = MotionPlayer(session, filming, go_on_after_stall)
        self._looks = FirstLooks(session, self._finder, self._player, look_again)

    @property
    def steps(self) -> int:
        """Simulated steps spent so far."""
        return self._finder.steps

    @property
    def trajectories_sent(self) -> int:
        """Motions that were sent to the robot so far."""
        return self._player.trajectories_sent

    def palm_position(self) -> np.ndarray:
        """Tool centre point as measured now, in the world in [m], shape (3,)."""
        return self._palm_at(np.array(self._session.client.state().q))

    @property
    def rest_palm_position(self) -> np.ndarray:
        """Tool centre point in the rest configuration, in the world in [m], shape (3,)."""
        return self._palm_at(np.array(REST_Q))

    def _palm_at(self, q: np.ndarray) -> np.ndarray:
        return (self._session.cell.robot.world_T_base @ self._robot.tcp_pose(q))[:3, 3]

    def attempt(self, spec: RewardSpec, scene: SceneEstimate) -> AttemptResult:
        """Try one subtask.

        Args:
            spec: What to achieve.
            scene: What was seen last.

        Returns:
            Whether the motion was played to its end, or why not; the loop looks again and judges the result.

        Raises:
            RobotGoneError, StoppedError, KeyboardInterrupt: Not failures of a subtask but ends of the run; a robot
                that stopped by itself waits for a person, so that ends the run as well.
            PerceptionError: It looked first, and nothing could be seen.
        """
        with self._session.watch.part("search"):
            scene = self._looks.at_things(spec, scene)
            found = self._finder.find(spec, scene, self._player.start())
            for _ in range(MOST_LOOKS):
                latest = self._looks.along(found)
                if latest is None:
                    break
                found = self._finder.find(spec, latest, self._player.start())
            if isinstance(found, FailureCause):
                return failed(self._session.episode, found)
            return self._player.play(found)

    def rehearse(
        self, spec: RewardSpec, scene: SceneEstimate, after: Rehearsal | None = None
    ) -> Rehearsal | FailureCause:
        """Find and judge a motion as `attempt` does, and send the robot nothing.

        Args:
            spec: What to achieve.
            scene: What was seen, or what a rehearsal says will be.
            after: The rehearsal that this one follows; None starts where the robot is.
        """
        with self._session.watch.part("search"):
            found = self._finder.find(spec, scene, self._player.start() if after is None else after.motion.ends)
        if isinstance(found, FailureCause):
            self._session.episode.log("rehearsed", spec=spec, cause=found)
            return found
        self._session.episode.log("rehearsed", spec=spec, cause=None)
        return Rehearsal(predicted_scene(scene, found.twin, found.twin_after), found)

    def play(self, rehearsal: Rehearsal) -> AttemptResult:
        """Play exactly the motion that was rehearsed; the driver refuses it when the arm stands elsewhere.

        Raises:
            RobotGoneError, StoppedError, KeyboardInterrupt: As for `attempt`.
        """
        return self._player.play(rehearsal.motion)

    def explain(self, spec: RewardSpec, scene: SceneEstimate) -> FailureCause | None:
        """Why a motion that was played as planned does not show: a lock, or bodies in the way; None for anything else.

        Args:
            spec: What it should have achieved.
            scene: What is seen now.
        """
        with self._session.watch.part("diagnosis"):
            return self._finder.explain(spec, scene, self._player.start())
