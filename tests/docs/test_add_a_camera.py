"""docs/how-to/add-a-camera.md: the source that it shows is a camera of a run."""

import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from hw_interface.cameras.source import CameraFailedError, CameraSource
from hw_interface.cell.client import CellClient
from perception.frames import CameraIntrinsics
from tests.hw_interface.test_ros2 import CELL
from tests.support.documents import ROOT, blocks
from tests.support.robot_side.hw_support import robot_process
from tests.support.waiting import until

SOURCE, OFFER = blocks(ROOT / "docs" / "how-to" / "add-a-camera.md", "python")
LENS = CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)


@pytest.fixture
def names() -> dict:
    """What the page's first example defines."""
    namespace: dict = {}
    exec(compile(SOURCE, "add-a-camera.md", "exec"), namespace)
    return namespace


def write(folder: Path, number: int) -> None:
    """One picture of a wall a metre away, whole from the moment that it has its name."""
    folder.mkdir(exist_ok=True)
    colour, depth = np.full((24, 32, 3), number % 256, np.uint8), np.ones((24, 32), np.float32)
    np.savez(folder / "new.npz", colour=colour, depth=depth)
    os.replace(folder / "new.npz", folder / f"{number:04d}.npz")


def test_pictures_come_in_order_with_their_number_and_time(names, tmp_path):
    source: CameraSource = names["FolderSource"](tmp_path, LENS, patience=0.05)
    write(tmp_path, 1)
    write(tmp_path, 2)
    shots = [source.read(), source.read()]
    assert [shot.number for shot in shots] == [1, 2]
    assert [int(shot.frame.colour[0, 0, 0]) for shot in shots] == [1, 2]
    assert abs(shots[1].frame.stamp - time.time()) < 60.0
    with pytest.raises(CameraFailedError, match=r"0003.npz did not come within 0.05 s; is its writer running\?"):
        source.read()


def test_a_client_of_the_robot_sees_what_the_source_gives(tmp_path):
    cell = CELL.replace("name: front", "name: tripod")
    assert cell != CELL
    (tmp_path / "my-bench.yaml").write_text(cell)
    over = threading.Event()

    def keep_writing() -> None:
        for number in itertools.count(1):
            write(tmp_path / "pictures", number)
            if over.wait(0.02):
                return

    with robot_process() as robot:
        offer = OFFER.replace("tcp/127.0.0.1:7447", robot.endpoint)
        assert offer != OFFER
        command = [sys.executable, "-c", f"{SOURCE}\n{offer}"]
        writer = threading.Thread(target=keep_writing)
        writer.start()
        camera = subprocess.Popen(command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)})
        try:
            with CellClient.connect(robot.endpoint) as client:
                assert until(lambda: "tripod" in client.cameras(), 60.0)
                (frame,) = client.frames(["tripod"])
            assert frame.camera == "tripod" and frame.colour.shape == (24, 32, 3)
            assert frame.world_T_camera[:3, 3] == pytest.approx([1.0, 0.0, 0.5]), "the cell file says where it stands"
        finally:
            over.set()
            writer.join()
            camera.send_signal(signal.SIGINT)
            assert camera.wait(30.0) == 0
