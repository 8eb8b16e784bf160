"""A run's recording: what was done, seen and said, decoded by another's decoder."""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from benchmarks.robot_side.perfect_robot import certificate, from_here
from control.errors import ConfigError
from hw_interface.cell.client import CellClient
from hw_interface.cell.process import SimProcess
from perception.recordings.opening import open_recording
from replan.run.episode import Episode
from replan.run.mcap_recording import RunRecording
from sim_check.cells.loading import load_cell
from tests.support.robot_side.hw_support import robot_process


@pytest.fixture(scope="module")
def robot() -> Iterator[SimProcess]:
    with robot_process() as process:
        yield process


def decoded(path: Path) -> dict[str, list[Any]]:
    """Messages of an MCAP file by topic."""
    found: dict[str, list[Any]] = defaultdict(list)
    with path.open("rb") as file:
        for _, channel, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            found[channel.topic].append(message)
    return found


def test_what_was_done_seen_and_said_is_in_the_recording_of_a_run(robot: SimProcess, tmp_path: Path):
    path, told = tmp_path / "run.mcap", []
    episode = Episode(tmp_path / "run")
    with CellClient.connect(robot.endpoint) as client:
        recording = RunRecording(path, robot.endpoint, load_cell("cubes"), None, told.append)
        episode.on_event, client.on_frame = recording.event, recording.frame
        say = recording.telling(told.append)
        say("robot: moving")
        frames = client.frames(["front"])
        motion = from_here(client, 0.5, 0.05)
        client.execute(motion, certificate(motion))
        episode.log("failure", cause="the hand closed on nothing")
        episode.log("long", text="x" * 5000)
        recording.close()
    messages = decoded(path)
    assert told == ["robot: moving"]
    lines = {m.name: (m.level, m.msg) for m in messages["/rosout"]}
    assert lines["replan"] == (20, "robot: moving")
    assert lines["replan.failure"] == (30, '{"cause": "the hand closed on nothing"}')
    assert len(lines["replan.long"][1]) < 2100
    (picture,) = messages["/front/color/image_raw"]
    assert bytes(picture.data) == frames[0].colour.tobytes()
    (played,) = messages["/executing_trajectory"]
    np.testing.assert_array_equal(played.points[-1].positions, motion.q[-1])
    (read,) = open_recording(path)
    np.testing.assert_array_equal(read.depth, frames[0].depth)
    np.testing.assert_allclose(read.world_T_camera, frames[0].world_T_camera, atol=1e-12)


def test_a_recording_overwrites_nothing(robot: SimProcess, tmp_path: Path):
    (tmp_path / "run.mcap").write_text("precious")
    with pytest.raises(ConfigError, match=r"run\.mcap' exists; name another file, or remove it"):
        RunRecording(tmp_path / "run.mcap", robot.endpoint, load_cell("cubes"), None, print)
