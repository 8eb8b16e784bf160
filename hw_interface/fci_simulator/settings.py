"""What a client may set on the control box, and the getters; ranges as libfranka's `robot.h` documents them."""

import struct

import numpy as np

from control.trajectory.samples import SAMPLE_TIME
from hw_interface.fci_simulator.arm import RigidLoad
from hw_interface.fci_simulator.collision import BoxThresholds
from hw_interface.fci_simulator.layout import Command, SetStatus
from hw_interface.fci_simulator.plant import Plant
from hw_interface.fci_simulator.robot_state import StateRecord

MOST_JOINT_STIFFNESS = 14250.0  # [Nm/rad]
STIFFNESS_OF_K = (10.0, 3000.0), (1.0, 300.0)  # [N/m], [Nm/rad]
MOST_CUTOFF = 1000.0  # [Hz]; a filter at it is off
FILTERS = ("joint_position", "joint_velocity", "cartesian_position", "cartesian_velocity", "controller")
# Size of an inactive virtual wall, its frame, and that it is not active.
NO_WALL = struct.pack("<19d?", *np.zeros(3), *np.eye(4).ravel(), False)


class Settings:
    """Settings of one box; those that touch the robot are carried out at once.

    Args:
        plant: The robot.
        record: Its state, which shows frames and load.

    Attributes:
        thresholds: When a contact is a collision.
        guiding: Which directions may be guided (x y z R P Y), then whether the elbow may.
    """

    def __init__(self, plant: Plant, record: StateRecord) -> None:
        self._plant, self._record = plant, record
        self.thresholds = BoxThresholds.default()
        self.guiding = (True,) * 7
        self._shares: dict[str, float] = dict.fromkeys(FILTERS, 1.0)

    def filter_share(self, name: str) -> float:
        """Share of a new command in the filtered one; one of `FILTERS`."""
        return self._shares[name]

    def apply(self, command: Command, body: bytes, moving: bool) -> tuple[int, bytes]:
        """Carry out a request; returns its status and what follows it."""
        wall = NO_WALL if command is Command.GET_CARTESIAN_LIMIT else b""
        if moving:
            return SetStatus.NOT_POSSIBLE, wall
        if command is Command.GET_CARTESIAN_LIMIT:
            return SetStatus.SUCCESS, wall
        if command is Command.SET_GUIDING_MODE:
            self.guiding = tuple(b != 0 for b in body)
            return SetStatus.SUCCESS, b""
        numbers = np.frombuffer(body, "<f8")
        valid = bool(np.isfinite(numbers).all()) and self._apply(command, numbers)
        return (SetStatus.SUCCESS if valid else SetStatus.INVALID_ARGUMENT), b""

    def _apply(self, command: Command, numbers: np.ndarray) -> bool:
        match command:
            case Command.SET_COLLISION_BEHAVIOR:
                return self._set_thresholds(numbers)
            case Command.SET_JOINT_IMPEDANCE:
                return self._set_stiffness(numbers)
            case Command.SET_CARTESIAN_IMPEDANCE:
                limits = np.repeat(np.array(STIFFNESS_OF_K), 3, axis=0)
                return bool(((numbers >= limits[:, 0]) & (numbers <= limits[:, 1])).all())
            case Command.SET_EE_TO_K | Command.SET_NE_TO_EE:
                return self._set_frame(command, numbers.reshape(4, 4).T.copy())
            case Command.SET_LOAD:
                return self._set_load(numbers)
            case Command.SET_FILTERS:
                return self._set_filters(numbers)
        return False

    def _set_thresholds(self, numbers: np.ndarray) -> bool:
        if not (numbers >= 0.0).all():
            return False
        self.thresholds = BoxThresholds.of(numbers)
        return True

    def _set_stiffness(self, numbers: np.ndarray) -> bool:
        if not ((numbers > 0.0) & (numbers <= MOST_JOINT_STIFFNESS)).all():
            return False
        self._plant.set_stiffness(numbers)
        return True

    def _set_frame(self, command: Command, pose: np.ndarray) -> bool:
        turn = pose[:3, :3]
        if not (np.allclose(turn @ turn.T, np.eye(3), atol=1e-5) and np.linalg.det(turn) > 0.0):
            return False
        if not np.array_equal(pose[3], (0.0, 0.0, 0.0, 1.0)):
            return False
        if command is Command.SET_EE_TO_K:
            self._record.EE_T_K = pose
        else:
            self._record.NE_T_EE = pose
        self._record.frames_changed()
        return True

    def _set_load(self, numbers: np.ndarray) -> bool:
        inertia = numbers[4:].reshape(3, 3).T
        if numbers[0] < 0.0 or not np.allclose(inertia, inertia.T) or np.linalg.eigvalsh(inertia).min() < -1e-12:
            return False
        load = RigidLoad(float(numbers[0]), numbers[1:4].copy(), inertia.copy())
        self._record.set_load(load)
        self._plant.arm.carry(load)
        return True

    def _set_filters(self, numbers: np.ndarray) -> bool:
        if not ((numbers >= 1.0) & (numbers <= MOST_CUTOFF)).all():
            return False
        for name, cutoff in zip(FILTERS, numbers, strict=True):
            # libfranka, `lowpass_filter.cpp`: gain = dt / (dt + 1 / (2 pi f)); at the highest frequency it is off.
            gain = SAMPLE_TIME / (SAMPLE_TIME + 1.0 / (2.0 * np.pi * float(cutoff)))
            self._shares[name] = 1.0 if cutoff >= MOST_CUTOFF else gain
        return True
