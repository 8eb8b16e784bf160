"""Recording a cell: the file gives back what the cameras saw, other programs read it, and every way to end is clean."""

import re
import signal
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from control.errors import ConfigError, RobotGoneError
from hw_interface.cell.client import CellClient
from hw_interface.cell.process import start_sim_process
from perception.errors import FrameError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.ground_truth import FrameTruth, TrueObject
from perception.recordings.mcap_stream import McapStream
from perception.recordings.mcap_writing import McapFrameWriter
from perception.recordings.opening import open_recording
from perception.recordings.recorded_truth import RecordedTruth
from perception.ros2.messages import camera_info, compressed_image, image, string, transforms
from replan.robot.options import RecordOptions
from replan.robot.record import record
from tests.support.robot_side.hw_support import robot_process
from tests.support.robot_side.ros2_cameras import compressed, info, tf
from tests.support.robot_side.ros2_cameras import image as image_message
from tests.support.robot_side.ros2_messages import STRING, write_mcap


def quiet(_text: str) -> None:
    """Nobody listens."""


@pytest.fixture(scope="module")
def cell():
    """A simulated cell that answers scorers, and a client of it."""
    command = [sys.executable, "-m", "replan.main", "robot", "sim", "--score", "--endpoint", "tcp/127.0.0.1:0"]
    with start_sim_process(command) as process, CellClient.connect(process.endpoint) as client:
        yield client


@pytest.fixture(scope="module")
def seen(cell):
    """Two looks of both cameras with what truly is in them."""
    return [(frame, cell.frame_truth(frame.camera)) for _ in range(2) for frame in cell.frames()]


@pytest.mark.parametrize(("depth", "compress"), [("16UC1", False), ("16UC1", True), ("32FC1", False)])
def test_a_recorded_cell_gives_back_its_frames_and_their_truth(tmp_path, seen, depth, compress):
    file = tmp_path / "cell.mcap"
    with McapFrameWriter(file, depth, compress, fixed={"static"}) as writer:
        for frame, truth in seen:
            writer.write(frame, truth)
    recording = open_recording(file)
    found = list(recording.with_truth())
    assert recording.has_truth and recording.skipped == []
    for (frame, truth), item in zip(seen, found, strict=True):
        back = item.frame
        assert (back.camera, back.intrinsics) == (frame.camera, frame.intrinsics)
        assert back.stamp == pytest.approx(frame.stamp, abs=1e-6)
        assert np.array_equal(back.colour, frame.colour)
        if depth == "32FC1":
            assert np.array_equal(back.depth, frame.depth, equal_nan=True)
        else:
            assert np.array_equal(np.isnan(back.depth), np.isnan(frame.depth))
            assert np.nanmax(np.abs(back.depth - frame.depth)) <= 0.0005 + 1e-6
        assert np.abs(back.world_T_camera - frame.world_T_camera).max() < 1e-6
        assert item.truth is not None and [o.name for o in item.truth.objects] == [o.name for o in truth.objects]
        for a, b in zip(item.truth.objects, truth.objects, strict=True):
            assert np.array_equal(a.mask, b.mask) and np.array_equal(a.world_T_object, b.world_T_object)  # type: ignore
            assert np.array_equal(a.extents, b.extents) and a.box_px.tolist() == b.box_px.tolist()  # type: ignore
            assert (a.shape, a.visible_share) == (b.shape, b.visible_share)


def test_the_truth_of_a_picture_agrees_with_the_pictures_depth_and_with_the_true_poses(cell, seen):
    poses = cell.truth().poses
    for frame, truth in seen:
        assert {o.name for o in truth.objects} == {"red_cube", "yellow_cube", "crate"}
        for o in truth.objects:
            assert np.allclose(o.world_T_object, poses[o.name], atol=1e-3), "it stands still"
            v, u = np.nonzero(o.mask & frame.valid_depth)
            z, k = frame.depth[v, u], frame.intrinsics
            points = np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z, np.ones_like(z)])
            own = np.linalg.inv(o.world_T_object) @ frame.world_T_camera @ points
            # Stereo noise is some millimetres, more at edges: nine in ten pixels lie within 15 mm of its box.
            inside = np.all(np.abs(own[:3].T) < o.extents / 2 + 0.015, axis=1)
            assert len(z) > 300 and inside.mean() > 0.9, o.name


def test_things_that_hide_each_other_show_a_share():
    from sim_check.cells.loading import load_cell
    from sim_check.world.world import build_world

    world = build_world(load_cell("cubes"), seed=0, meshes=False)
    try:
        frame = {name: world.object_pose(name) for name in world.object_names}
        eye = world.data.cam_xpos[world.model.camera("static").id]
        # The yellow cube half way on the ray from the camera to the crate hides part of it.
        address = world.model.joint("yellow_cube").qposadr[0]
        world.data.qpos[address : address + 3] = (eye + frame["crate"][:3, 3]) / 2
        import mujoco

        mujoco.mj_forward(world.model, world.data)
        shares = {o.name: o.visible_share for o in world.frame_truth("static").objects}
        assert (shares["yellow_cube"] > 0.99 and 0.02 < shares.get("crate", 0.0) < 0.8) or "crate" not in shares
        assert shares["red_cube"] > 0.95
    finally:
        world.close()


def test_replan_record_takes_pictures_at_its_rate_and_says_which_cameras_stand_still(tmp_path, cell):
    lines = []
    options = RecordOptions(tmp_path / "cell.mcap", robot=cell.endpoint, frames=2, rate=1000.0, truth=True)
    report = record(options, lines.append)
    assert report.frames == {"static": 2, "wrist": 2} and report.has_truth and report.exit_code == 0
    assert report.size == (tmp_path / "cell.mcap").stat().st_size
    assert report.as_text().startswith("recorded 2 of camera 'static', 2 of camera 'wrist' in ")
    assert lines[:1] == [f"recording static, wrist into {tmp_path / 'cell.mcap'}: 2 frames; Ctrl-C ends it"]
    topics = McapStream(tmp_path / "cell.mcap").topics
    assert topics["/tf_static"] == topics["/tf"] == "tf2_msgs/msg/TFMessage"
    with (tmp_path / "cell.mcap").open("rb") as file:
        counts = make_reader(file).get_summary()
        assert counts is not None and counts.statistics is not None
        number = {c.topic: counts.statistics.channel_message_counts[i] for i, c in counts.channels.items()}
    assert (number["/tf_static"], number["/tf"], number["/replan/truth"]) == (1, 2, 4)
    assert len(list(open_recording(tmp_path / "cell.mcap"))) == 4


def test_only_cells_that_were_started_for_scoring_say_what_is_in_a_picture(tmp_path):
    with robot_process("unscored") as robot, CellClient.connect(robot.endpoint) as client:
        with pytest.raises(ConfigError, match=r"only a simulated cell that was started with --score does"):
            record(RecordOptions(tmp_path / "x.mcap", robot=robot.endpoint, truth=True), quiet)
        with pytest.raises(RobotGoneError):
            client.frame_truth("front")


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"rate": 0.0}, "--rate 0 is not valid; it is frames a second"),
        ({"seconds": -1.0}, "--seconds -1 is not valid; it must be above 0"),
        ({"frames": 0}, "--frames 0 is not valid; it must be 1 or more"),
        ({"compress": True, "depth": "32FC1"}, "--compress keeps depth as 16-bit PNG"),
        ({"out": "x.bag"}, r"'.*x\.bag' is no name of an MCAP file; it must end in \.mcap"),
    ],
)
def test_options_that_are_not_valid_are_refused_before_anything_starts(tmp_path, changes, text):
    options = {"out": "x.mcap", **changes}
    with pytest.raises(ConfigError, match=text):
        record(RecordOptions(**{**options, "out": tmp_path / options["out"]}), quiet)


def test_a_file_that_exists_is_not_overwritten(tmp_path):
    (tmp_path / "x.mcap").write_text("precious")
    with pytest.raises(ConfigError, match="exists; name another file, or remove it"):
        record(RecordOptions(tmp_path / "x.mcap"), quiet)
    assert (tmp_path / "x.mcap").read_text() == "precious"


def test_a_camera_that_is_not_there_is_refused_with_those_that_are(tmp_path):
    with robot_process() as robot, pytest.raises(ConfigError, match="no camera 'top'; it has front, side"):
        record(RecordOptions(tmp_path / "x.mcap", robot=robot.endpoint, cameras=("top",)), quiet)


def test_ctrl_c_ends_a_recording_with_a_complete_file_and_exit_code_0(tmp_path):
    file = tmp_path / "x.mcap"
    with robot_process() as robot:
        command = [sys.executable, "-m", "replan.main", "record", str(file), "--robot", robot.endpoint, "--rate", "50"]
        process = subprocess.Popen([*command, "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert process.stderr is not None
        for line in process.stderr:
            if (told := re.search(r"(\d+) frames a camera", line)) and int(told[1]) >= 2:
                break
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate()
    assert process.returncode == 0 and '"interrupted": true' in out
    with file.open("rb") as stream:
        assert make_reader(stream).get_summary() is not None, "complete files have a summary"
    recording = open_recording(file)
    assert len(list(recording)) >= 2 and recording.skipped == []


def test_a_robot_that_goes_away_leaves_what_was_recorded_until_then(tmp_path):
    file = tmp_path / "x.mcap"
    with robot_process() as robot:

        def end(text: str) -> None:
            if "frames a camera" in text:
                robot.close()

        with pytest.raises(RobotGoneError):
            record(RecordOptions(file, robot=robot.endpoint, rate=50.0), end)
    recording = open_recording(file)
    assert len(list(recording)) >= 2 and recording.skipped == []


def test_messages_are_encoded_to_the_byte_as_another_programs_writer_does(tmp_path):
    stamp, frame = 1_234_567_890_123_456_789, "cam_optical"
    rng = np.random.default_rng(0)
    rgb, metres = rng.integers(0, 255, (5, 7, 3), dtype=np.uint8), rng.random((5, 7)).astype(np.float32)
    turned = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_quat()
    matrix = np.array([[10.0, 0, 3.0], [0, 11.0, 2.0], [0, 0, 1.0]])

    def at(message):
        content = message[2]
        inner = content["transforms"][0] if "transforms" in content else content
        if "header" in inner:
            inner["header"]["stamp"] = {"sec": stamp // 10**9, "nanosec": stamp % 10**9}
        return message

    theirs = [
        image_message("/a", 0.0, "rgb8", rgb),
        image_message("/b", 0.0, "32FC1", metres),
        compressed("/c", 0.0, "png", b"12345"),
        info("/d", 7, 5),
        tf(0.0, "world", frame, (1.0, 2.0, 3.0), turned),
        ("/f", STRING, {"data": "äöü"}),
    ]
    ours = [
        image(stamp, frame, "rgb8", rgb),
        image(stamp, frame, "32FC1", metres),
        compressed_image(stamp, frame, "png", b"12345"),
        camera_info(stamp, frame, 7, 5, matrix),
        transforms([(stamp, "world", frame, np.array([1.0, 2.0, 3.0]), turned)]),
        string("äöü"),
    ]
    file = write_mcap(tmp_path / "theirs.mcap", [at(m) for m in theirs])
    with file.open("rb") as stream:
        encoded = [m.data for _, _, m in make_reader(stream).iter_messages()]
    assert encoded == ours


def made(count: int, width: int = 64, height: int = 48):
    """Frames of noise from a moving camera."""
    rng = np.random.default_rng(1)
    lens = CameraIntrinsics(width, height, 60.0, 61.0, width / 2, height / 2)
    for k in range(count):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = Rotation.from_euler("xyz", rng.normal(size=3)).as_matrix(), rng.normal(size=3)
        depth = rng.uniform(0.3, 2.0, (height, width)).astype(np.float32)
        colour = rng.integers(0, 255, (height, width, 3), dtype=np.uint8)
        yield RgbdFrame(colour, depth, lens, pose, 1.7e9 + 0.1 * k, "front cam")


def test_another_programs_reader_decodes_every_message(tmp_path):
    with McapFrameWriter(tmp_path / "x.mcap") as writer:
        for frame in made(2):
            writer.write(frame, FrameTruth((), ("lime",)))
    with (tmp_path / "x.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = {c.topic: m for _, c, _, m in reader.iter_decoded_messages()}
        assert reader.get_header().profile == "ros2"
    assert set(messages) == {
        "/front_cam/color/image_raw",
        "/front_cam/color/camera_info",
        "/front_cam/aligned_depth_to_color/image_raw",
        "/front_cam/aligned_depth_to_color/camera_info",
        "/tf",
        "/replan/truth",
    }
    depth, lens = messages["/front_cam/aligned_depth_to_color/image_raw"], messages["/front_cam/color/camera_info"]
    assert (depth.encoding, depth.width, depth.step, depth.header.frame_id) == ("16UC1", 64, 128, lens.header.frame_id)
    assert list(lens.k) == [60.0, 0.0, 32.0, 0.0, 61.0, 24.0, 0.0, 0.0, 1.0] and list(lens.d) == [0.0] * 5
    assert messages["/tf"].transforms[0].header.frame_id == "world"
    assert RecordedTruth.parse(messages["/replan/truth"].data).absent == ("lime",)


def test_depth_beyond_what_16_bits_hold_becomes_unknown(tmp_path):
    (frame,) = made(1)
    depth = frame.depth.copy()
    depth[0, :3] = 70.0, np.inf, 0.0002
    far = RgbdFrame(frame.colour, depth, frame.intrinsics, frame.world_T_camera, frame.stamp, frame.camera)
    with McapFrameWriter(tmp_path / "x.mcap") as writer:
        writer.write(far)
    (back,) = open_recording(tmp_path / "x.mcap")
    assert np.isnan(back.depth[0, :3]).all() and np.isnan(back.depth).sum() == 3


def test_a_truth_that_is_not_valid_is_named_and_only_scorers_meet_it(tmp_path):
    with pytest.raises(FrameError, match=r"the truth of a frame is not valid: objects: Field required"):
        RecordedTruth.parse('{"camera": "front", "stamp_ns": 3}')
    with pytest.raises(FrameError, match=r"colour: Extra inputs are not permitted"):
        RecordedTruth.parse('{"camera": "front", "stamp_ns": 3, "objects": [], "colour": 1}')


def test_a_truth_without_masks_keeps_poses_sizes_and_joints(tmp_path):
    (frame,) = made(1)
    door = TrueObject("cabinet", np.eye(4), np.array([0.3, 0.4, 0.5]), joint_fractions={"door": 0.25})
    with McapFrameWriter(tmp_path / "x.mcap") as writer:
        writer.write(frame, FrameTruth((door,)))
    (item,) = open_recording(tmp_path / "x.mcap").with_truth()
    assert item.truth is not None
    (found,) = item.truth.objects
    assert found.mask is None and dict(found.joint_fractions) == {"door": 0.25} and found.shape is None


def test_reading_holds_a_few_frames_and_not_the_recording(tmp_path):
    with McapFrameWriter(tmp_path / "x.mcap", depth="32FC1") as writer:
        for frame in made(60, 320, 240):
            writer.write(frame)
    size = (tmp_path / "x.mcap").stat().st_size
    assert size > 25e6
    next(iter(open_recording(tmp_path / "x.mcap")))  # what is imported on the way is no part of what reading holds
    tracemalloc.start()
    try:
        recording = open_recording(tmp_path / "x.mcap")
        assert sum(1 for _ in recording) == 60
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # A chunk compressed, whole and cut into its messages, and the pictures of one frame: about four chunks of 4 MB.
    assert peak < 18e6
