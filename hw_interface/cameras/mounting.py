"""Where a camera was when it took a picture: fixed in the world, or on the hand, which moves with the arm."""

import bisect
import threading
import time
from collections import deque
from typing import Protocol

import numpy as np
import zenoh

from control.errors import RefusedError
from control.robot.description import HAND_FRAME, arm_model
from control.robot.dynamics import RobotModel
from control.robot.gripper import GripperModel
from hw_interface.link.streams import StateReader
from hw_interface.messages.robot import RobotState

NO_ARM_POSE = "no_arm_pose"  # code of the refusal
KEPT = 2.0  # [s] of states; pictures are older by what exposure, read-out and transfer take
NEAR = 0.05  # [s] from a picture's stamp to the state before and to that after it; states come every 14 ms
PATIENCE = 0.2  # [s] for the state after a picture's stamp


class CameraMounting(Protocol):
    """Where a camera is."""

    def pose(self, stamp: float) -> np.ndarray:
        """Pose of its optical frame in the world, shape (4, 4).

        Args:
            stamp: Time of exposure on the robot's clock in [s].

        Raises:
            RefusedError: no_arm_pose: it cannot be known.
        """
        ...


class FixedMounting:
    """A camera that stands still.

    Args:
        world_T_camera: Pose of its optical frame, shape (4, 4).
    """

    def __init__(self, world_T_camera: np.ndarray) -> None:
        self._pose = world_T_camera

    def pose(self, stamp: float) -> np.ndarray:
        """As in `CameraMounting`."""
        return self._pose


class ArmStates:
    """The latest measured joint positions, by the robot's stamps."""

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._stamps: deque[float] = deque()
        self._q: deque[tuple[float, ...]] = deque()

    def add(self, stamp: float, q: tuple[float, ...]) -> None:
        """Take in a state: stamp in [s], joint positions in [rad]; from any thread."""
        with self._news:
            if self._stamps and stamp <= self._stamps[-1]:
                self._stamps.clear()  # the robot's clock was set, or another robot took its place
                self._q.clear()
            self._stamps.append(stamp)
            self._q.append(q)
            while self._stamps[-1] - self._stamps[0] > KEPT:
                self._stamps.popleft()
                self._q.popleft()
            self._news.notify_all()

    def at(self, stamp: float, patience: float = PATIENCE) -> np.ndarray:
        """Joint positions at a time in [rad], shape (7,): on the line between the states before and after it.

        Args:
            stamp: Time on the robot's clock in [s].
            patience: How long to wait for the state after it in [s].

        Raises:
            RefusedError: no_arm_pose: no state is near enough before or after it.
        """
        until = time.monotonic() + patience
        with self._news:
            while not self._stamps or self._stamps[-1] < stamp:
                left = until - time.monotonic()
                if left <= 0.0:
                    break
                self._news.wait(left)
            stamps, q = list(self._stamps), list(self._q)
        after = bisect.bisect_left(stamps, stamp)
        if after < len(stamps) and stamps[after] == stamp:
            return np.array(q[after])
        if not 0 < after < len(stamps) or max(stamps[after] - stamp, stamp - stamps[after - 1]) > NEAR:
            far = min((abs(s - stamp) for s in stamps), default=None)
            nearest = "no state has come" if far is None else f"the nearest state is {1000 * far:.0f} ms from it"
            raise RefusedError(
                NO_ARM_POSE,
                f"where the arm was when the picture was taken is not known: {nearest}, and one is needed within "
                f"{1000 * NEAR:.0f} ms before and after it; see whether the robot process publishes its state and "
                "whether the clocks agree (replan doctor)",
            )
        share = (stamp - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
        return (1.0 - share) * np.array(q[after - 1]) + share * np.array(q[after])


class WristMounting:
    """A camera on the hand.

    Args:
        session: Session on which the robot's states are heard.
        gripper: What hangs at the flange.
        world_T_base: Pose of the robot's base, shape (4, 4).
        hand_T_camera: Pose of the optical frame in the frame panda_hand, shape (4, 4).
    """

    def __init__(
        self, session: zenoh.Session, gripper: GripperModel, world_T_base: np.ndarray, hand_T_camera: np.ndarray
    ) -> None:
        self._robot = RobotModel(arm_model(gripper, gripper.opening), HAND_FRAME, gripper)
        self._world_T_base = world_T_base
        self._hand_T_camera = hand_T_camera
        self.states = ArmStates()
        self._reader = StateReader(session, self._on_state)

    def pose(self, stamp: float) -> np.ndarray:
        """As in `CameraMounting`."""
        return self._world_T_base @ self._robot.tcp_pose(self.states.at(stamp)) @ self._hand_T_camera

    def _on_state(self, state: RobotState) -> None:
        self.states.add(state.stamp, state.q)
