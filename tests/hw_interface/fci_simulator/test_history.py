"""The simulated box's own record: what a client made the arm do, and what the box did by itself."""

import struct

import numpy as np

from control.robot.gripper import PANDA_HAND
from control.robot.limits import panda_limits
from hw_interface.fci_simulator.control_box import ControlBox
from hw_interface.fci_simulator.layout import COMMAND, Controller, Error, Generator
from hw_interface.fci_simulator.plant import Plant
from tests.support.robot_side.hw_sim_world import CubeWorld


def test_only_what_a_client_commanded_counts_as_told_not_what_comes_too_late(tmp_path):
    world, said = CubeWorld(), []
    box = ControlBox(Plant(world.model, world.data, PANDA_HAND), panda_limits(), said.append)
    box.move(1, struct.pack("<II", Controller.JOINT_IMPEDANCE, Generator.JOINT_POSITION) + bytes(64))
    assert box.motion is not None, said
    commands = np.zeros(1, COMMAND)
    start = box._set_point.q.copy()

    def tick(row: int | None) -> None:
        if row is not None:
            commands["q_c"][0] = start + 10.0 * (row / 1000.0) ** 4 * np.ones(7)
        box.tick(None if row is None else commands[0])

    for row in range(1, 101):
        tick(row)
    tick(None)  # lost: the box goes on by itself
    tick(102)
    box.reflex(Error.COMMUNICATION)
    for row in range(103, 106):
        tick(row)
    box.history.write(tmp_path / "history.npz")
    with np.load(tmp_path / "history.npz") as history:
        assert history["told"].tolist() == [True] * 100 + [False, True] + [False] * 3
        assert np.any(np.diff(history["q_d"], axis=0)[-3:] != 0.0), "it brakes meanwhile"


def test_giving_way_to_a_blow_is_the_boxs_own_doing(tmp_path):
    world, said = CubeWorld(), []
    box = ControlBox(Plant(world.model, world.data, PANDA_HAND), panda_limits(), said.append)
    box.move(1, struct.pack("<II", Controller.JOINT_IMPEDANCE, Generator.JOINT_POSITION) + bytes(64))
    commands = np.zeros(1, COMMAND)
    commands["q_c"][0] = box._set_point.q
    for _ in range(20):
        box.tick(commands[0])
    box.push(np.full(7, 80.0), 0.2)
    while box.motion is not None:
        box.tick(commands[0])
    box.history.write(tmp_path / "history.npz")
    with np.load(tmp_path / "history.npz") as history:
        assert box.errors and history["told"][:20].all() and not history["told"][-1]
