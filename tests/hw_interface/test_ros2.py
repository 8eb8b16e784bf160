"""ROS 2's messages and names: decoded by another program, hashed as published, heard on the wire and in a file."""

import dataclasses
import math
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import zenoh
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from benchmarks.robot_side.perfect_robot import FIRMWARE, PROFILE, blank_frame, certificate, from_here, perfect_driver
from control.errors import ConfigError
from control.robot.dynamics import RobotModel
from control.robot.gripper import PANDA_HAND, ROBOTIQ_2F85
from control.robot.limits import JOINT_NAMES, REST_Q
from hw_interface.cell.client import CellClient
from hw_interface.cell.process import SimProcess
from hw_interface.link.transport import open_client_session
from hw_interface.messages.robot import RobotState, Trouble
from hw_interface.ros2 import encoding
from hw_interface.ros2.keys import BridgeNaming, RmwNaming
from hw_interface.ros2.link_tree import LinkTree
from hw_interface.ros2.view import WORLD, MountedCamera, Ros2View
from perception.ros2.messages import STRING, TF, definition, type_hash
from replan.robot.options import Ros2Options
from replan.robot.ros2_view import show_ros2
from tests.support.robot_side.hw_support import robot_process
from tests.support.robot_side.ros2_messages import DEFINITIONS as KNOWN_DEFINITIONS
from tests.support.robot_side.ros2_messages import decode_ros2
from tests.support.waiting import until

STAMP = 1_700_000_000.25
# As rosidl generates them: found in the generated code and recordings of Iron, Jazzy, Kilted and Rolling.
PUBLISHED_HASHES = {
    "builtin_interfaces/msg/Time": "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197",
    "std_msgs/msg/Header": "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "sensor_msgs/msg/JointState": "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    "sensor_msgs/msg/Image": "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    "sensor_msgs/msg/CameraInfo": "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "trajectory_msgs/msg/JointTrajectory": "179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e",
    "rcl_interfaces/msg/Log": "e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac",
    "diagnostic_msgs/msg/KeyValue": "d68081eaa540288c5440753baecef0c4e16e81a5f78ad68902ded5100413bb42",
}
CELL = """
name: test
cameras:
  - {name: front, mounting: static, position: [1.0, 0.0, 0.5], look_at: [0.4, 0.0, 0.0], fx: 30, fy: 30, width: 32,
     height: 24}
  - {name: wrist, mounting: wrist, position: [0.05, 0.0, 0.05], quaternion: [1, 0, 0, 0], fx: 30, fy: 30}
robot: {position: [0.1, 0.2, 0.0], yaw_deg: 90}
objects: [red_cube]
"""


def a_state(**changes) -> RobotState:
    """A state of the test's robot."""
    driver, _ = perfect_driver()
    return driver.state().model_copy(update={"stamp": STAMP, **changes})


def a_view() -> Ros2View:
    """A view of a robot that stands beside the world's origin, with a camera in the world."""
    base = np.eye(4)
    base[:3, 3] = [0.1, 0.2, 0.0]
    eye = np.eye(4)
    eye[:3, 3] = [1.0, 0.0, 0.5]
    return Ros2View(PANDA_HAND, base, (MountedCamera("front", WORLD, eye),))


def by_topic(messages) -> dict:
    """Decoded messages by topic."""
    return {m.topic: decode_ros2(m.kind, m.data) for m in messages}


def chain(transforms, child: str) -> np.ndarray:
    """Pose of a frame in the world, by the transforms that lead there."""
    parents = {t.child_frame_id: t for t in transforms}
    pose = np.eye(4)
    while child != WORLD:
        t = parents[child]
        step = np.eye(4)
        q, p = t.transform.rotation, t.transform.translation
        step[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
        step[:3, 3] = [p.x, p.y, p.z]
        pose, child = step @ pose, t.header.frame_id
    return pose


@pytest.mark.parametrize("kind", PUBLISHED_HASHES)
def test_the_hash_of_a_type_is_the_one_that_ros_publishes(kind: str):
    assert type_hash(kind) == f"RIHS01_{PUBLISHED_HASHES[kind]}"


@pytest.mark.parametrize("kind", [*PUBLISHED_HASHES, "diagnostic_msgs/msg/DiagnosticArray"])
def test_definitions_are_those_of_ros(kind: str):
    first, *others = definition(kind).split("=" * 80 + "\nMSG: ")
    texts = {kind.replace("/msg/", "/"): first, **dict(text.split("\n", 1) for text in others)}
    for name, text in texts.items():
        fields = [line for line in text.splitlines() if "=" not in line]  # constants count neither in bytes nor hashes
        assert fields == KNOWN_DEFINITIONS[name].splitlines(), name


def test_joints_are_decoded_by_another_programs_decoder():
    state = a_state(gripper_width=0.05, q=(0.1, 0.2, 0.3, -1.5, 0.5, 0.6, 0.7))
    (joints, *_) = a_view().state(state)
    decoded = decode_ros2(joints.kind, joints.data)
    assert (decoded.header.stamp.sec, decoded.header.stamp.nanosec) == (1_700_000_000, 250_000_000)
    assert decoded.header.frame_id == "panda_link0"
    assert list(decoded.name) == [*JOINT_NAMES, "panda_finger_joint1", "panda_finger_joint2"]
    np.testing.assert_array_equal(decoded.position, [*state.q, 0.025, 0.025])
    assert len(decoded.velocity) == len(decoded.effort) == 9
    np.testing.assert_array_equal(decoded.effort[:7], state.tau)
    assert all(math.isnan(e) for e in decoded.effort[7:]), "the force of the fingers is not measured"


def test_the_speed_of_the_fingers_is_the_difference_of_two_states():
    view = a_view()
    view.state(a_state(gripper_width=0.05))
    (joints, *_) = view.state(a_state(gripper_width=0.04, stamp=STAMP + 0.1))
    np.testing.assert_allclose(decode_ros2(joints.kind, joints.data).velocity[7:], [-0.05, -0.05], rtol=1e-4)


def test_a_gripper_without_described_fingers_has_no_finger_joints():
    view = Ros2View(ROBOTIQ_2F85, np.eye(4))
    decoded = by_topic(view.state(a_state()))
    assert list(decoded["joint_states"].name) == list(JOINT_NAMES)
    fixed = by_topic([view.fixed(STAMP)])["tf_static"].transforms
    assert "panda_hand" in {t.child_frame_id for t in fixed}


def test_transforms_lead_from_the_world_to_where_the_hand_is():
    view = a_view()
    q = np.array(REST_Q) + 0.1
    moving = by_topic(view.state(a_state(q=tuple(q.tolist()), gripper_width=0.06)))["tf"].transforms
    fixed = by_topic([view.fixed(STAMP)])["tf_static"].transforms
    both = [*moving, *fixed]
    assert len({t.child_frame_id for t in both}) == len(both), "every link has one parent"
    expected = RobotModel.panda().tcp_pose(q)
    expected[:3, 3] += [0.1, 0.2, 0.0]
    np.testing.assert_allclose(chain(both, "panda_hand_tcp"), expected, atol=1e-9)
    between = np.linalg.inv(chain(both, "panda_leftfinger")) @ chain(both, "panda_rightfinger")
    assert abs(abs(between[1, 3]) - 0.06) < 1e-9, "the fingers are as far apart as the gripper is open"
    np.testing.assert_allclose(chain(both, "front_color_optical_frame")[:3, 3], [1.0, 0.0, 0.5])


def test_no_link_of_the_description_is_left_out():
    tree = LinkTree(PANDA_HAND)
    children = {p.child for p in (*tree.fixed(), *tree.moving(np.array(REST_Q), 0.0))}
    links = {f"panda_link{i}" for i in range(1, 9)}
    assert children == links | {"panda_hand", "panda_hand_tcp", "panda_leftfinger", "panda_rightfinger"}


def test_the_mode_and_diagnostics_come_when_the_mode_changes_and_every_second():
    view = a_view()
    assert by_topic(view.state(a_state()))["robot_mode"].data == "idle"
    assert "robot_mode" not in by_topic(view.state(a_state(stamp=STAMP + 0.5)))
    trouble = Trouble(code="contact", reason="the arm felt 30 N")
    changed = view.state(a_state(stamp=STAMP + 0.6, mode="reflex", last_error=trouble))
    data = {m.topic: m.data for m in changed}["diagnostics"]
    decoded = decode_ros2(encoding.DIAGNOSTICS, data)
    (status,) = decoded.status
    assert status.level in (2, b"\x02") and status.message == "reflex: the arm felt 30 N"
    values = {v.key: v.value for v in status.values}
    assert values["error"] == "contact" and values["profile"] == PROFILE and values["firmware"] == FIRMWARE
    assert "robot_mode" in by_topic(view.state(a_state(stamp=STAMP + 1.7, mode="reflex")))


def test_a_motion_keeps_its_ends_and_a_point_every_ten_milliseconds():
    from benchmarks.robot_side.perfect_robot import swing

    motion = swing(0.503, 0.2)
    message = a_view().trajectory(motion, STAMP)
    rows = [*range(0, 501, 10), 503]
    decoded = decode_ros2(message.kind, message.data)
    assert list(decoded.joint_names) == list(JOINT_NAMES)
    np.testing.assert_array_equal([p.positions for p in decoded.points], motion.q[rows])
    np.testing.assert_array_equal([p.velocities for p in decoded.points], motion.qd[rows])
    np.testing.assert_array_equal([p.accelerations for p in decoded.points], motion.qdd[rows])
    times = [p.time_from_start.sec + p.time_from_start.nanosec / 1e9 for p in decoded.points]
    np.testing.assert_allclose(times, np.array(rows) / 1000, atol=1e-12)


def test_pictures_have_their_lens_and_depth_in_metres():
    frame = dataclasses.replace(blank_frame("side"), stamp=STAMP)
    depth = frame.depth.copy()
    depth[3, 4] = np.nan
    frame = dataclasses.replace(frame, depth=depth)
    decoded = by_topic(a_view().frame(frame))
    assert set(decoded) == {
        "side/color/image_raw",
        "side/color/camera_info",
        "side/aligned_depth_to_color/image_raw",
        "side/aligned_depth_to_color/camera_info",
        "tf",
    }, "a camera that the cell does not place brings its pose with it"
    picture, far = decoded["side/color/image_raw"], decoded["side/aligned_depth_to_color/image_raw"]
    assert (picture.encoding, picture.step, far.encoding, far.step) == ("rgb8", 96, "32FC1", 128)
    np.testing.assert_array_equal(np.frombuffer(bytes(picture.data), np.uint8).reshape(24, 32, 3), frame.colour)
    np.testing.assert_array_equal(np.frombuffer(bytes(far.data), "<f4").reshape(24, 32), depth)
    info = decoded["side/color/camera_info"]
    np.testing.assert_array_equal(np.reshape(info.k, (3, 3)), frame.intrinsics.matrix)
    assert "tf" not in by_topic(a_view().frame(dataclasses.replace(frame, camera="front")))


def test_what_happened_is_a_line_of_the_log():
    message = a_view().event(STAMP, "warn", "replan", "the hand closed on nothing")
    decoded = decode_ros2(message.kind, message.data)
    assert (decoded.level, decoded.name, decoded.msg) == (30, "replan", "the hand closed on nothing")


def test_names_for_the_bridge_are_those_of_its_topics():
    naming = BridgeNaming("lab/panda1")
    assert BridgeNaming().key("tf", TF) == "tf"
    assert naming.key("joint_states", encoding.JOINT_STATE) == "lab/panda1/joint_states"
    assert naming.token("tf_static", TF, "abc", 3, True) == (
        "@/abc/@ros2_lv/MP/lab§panda1§tf_static/tf2_msgs§msg§TFMessage/:1:1:0,1"
    )
    assert naming.attachment(1, b"") is None


def test_names_for_rmw_zenoh_carry_type_and_hash():
    naming = RmwNaming(7, "panda1")
    hashed = f"RIHS01_{PUBLISHED_HASHES['std_msgs/msg/String']}"
    key = naming.key("robot_mode", STRING)
    assert key == f"7/panda1/robot_mode/std_msgs::msg::dds_::String_/{hashed}"
    assert naming.token("robot_mode", STRING, "abc", 3, False) == (
        f"@ros2_lv/7/abc/0/3/MP/%/%panda1/replan/%panda1%robot_mode/std_msgs::msg::dds_::String_/{hashed}/::,10:,:,:,,"
    )
    assert RmwNaming().node_token("abc") == "@ros2_lv/0/abc/0/0/NN/%/%/replan"
    # Number and time as 64-bit little-endian, then the length of the sender and the sender.
    before = time.time_ns()
    attachment = naming.attachment(5, bytes(range(16)))
    assert attachment is not None and len(attachment) == 33
    assert attachment[:8] == (5).to_bytes(8, "little") and attachment[16:] == bytes([16, *range(16)])
    assert before <= int.from_bytes(attachment[8:16], "little") <= time.time_ns()


@pytest.fixture(scope="module")
def robot() -> Iterator[SimProcess]:
    with robot_process() as process:
        yield process


@pytest.fixture(scope="module")
def cell_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cell") / "test.yaml"
    path.write_text(CELL)
    return path


@contextmanager
def ros2_process(robot: SimProcess, cell: Path, *options: str) -> Iterator["subprocess.Popen[str]"]:
    """`replan ros2` in a process of its own, ended afterwards if it has not."""
    command = [sys.executable, "-m", "replan.main", "ros2", "--robot", robot.endpoint, "--cell", str(cell), *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert process.stdout is not None
    try:
        for line in process.stdout:
            if "Ctrl-C ends it" in line:
                break
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.wait()
        process.stdout.close()


@contextmanager
def heard(endpoint: str, keys: str) -> Iterator[tuple[zenoh.Session, list]]:
    """A session, and what is published on these keys."""
    session, samples = open_client_session(endpoint), []
    session.declare_subscriber(keys, samples.append)
    try:
        yield session, samples
    finally:
        session.close()


@pytest.fixture(scope="module")
def shown(robot: SimProcess, cell_file: Path) -> Iterator[None]:
    """A running `replan ros2` for zenoh-bridge-ros2dds, in the namespace panda1."""
    with ros2_process(robot, cell_file, "--namespace", "panda1", "--camera-rate", "5"):
        yield


def test_another_session_hears_the_cell_and_the_motion_that_it_plays(robot: SimProcess, shown: None):
    with heard(robot.endpoint, "panda1/**") as (session, samples), CellClient.connect(robot.endpoint) as client:
        of = lambda name: [s.payload.to_bytes() for s in list(samples) if str(s.key_expr) == f"panda1/{name}"]  # noqa: E731
        states = lambda: [decode_ros2(encoding.JOINT_STATE, data) for data in of("joint_states")]  # noqa: E731
        swept = lambda: [state.position[0] for state in states()]  # noqa: E731
        motion = from_here(client, 0.5, 0.05)
        assert client.execute(motion, certificate(motion)).completed
        wanted = {"joint_states", "tf", "tf_static", "robot_mode", "diagnostics", "executing_trajectory"}
        wanted |= {f"{c}/{part}" for c in ("front", "side") for part in ("color/image_raw", "color/camera_info")}
        there = lambda: {str(s.key_expr).removeprefix("panda1/") for s in list(samples)}  # noqa: E731
        assert until(lambda: wanted <= there()), wanted - there()
        # A reader hears the states a little after the client hears that the motion is done.
        assert until(lambda: abs(max(swept()) - max(motion.q[:, 0])) < 1e-9), (
            "the end of the motion is among the states"
        )
        tokens = [str(r.ok.key_expr) for r in session.liveliness().get("@/*/@ros2_lv/**") if r.ok is not None]
        assert any("/MP/panda1§joint_states/sensor_msgs§msg§JointState/" in t for t in tokens)
    (played,) = [decode_ros2(encoding.JOINT_TRAJECTORY, data) for data in of("executing_trajectory")]
    np.testing.assert_array_equal(played.points[-1].positions, motion.q[-1])
    modes = [decode_ros2(STRING, data).data for data in of("robot_mode")]
    assert {"idle", "moving"} <= set(modes)
    stamps = [j.header.stamp.sec + j.header.stamp.nanosec / 1e9 for j in states()]
    assert np.median(np.diff(stamps)) < 0.03


def test_a_reader_that_comes_later_still_learns_the_fixed_transforms(robot: SimProcess, shown: None):
    with heard(robot.endpoint, "panda1/tf_static") as (_, samples):
        assert until(lambda: bool(samples), 3.0)
    transforms = decode_ros2(TF, samples[0].payload.to_bytes()).transforms
    mounted = {t.child_frame_id: t.header.frame_id for t in transforms}
    assert mounted["front_color_optical_frame"] == "world" and mounted["wrist_color_optical_frame"] == "panda_hand"
    base = next(t for t in transforms if t.child_frame_id == "panda_link0")
    assert (base.transform.translation.x, base.transform.translation.y) == (0.1, 0.2)
    assert abs(base.transform.rotation.z - math.sqrt(0.5)) < 1e-9


def test_nodes_of_rmw_zenoh_hear_keys_with_hashes_and_numbered_messages(robot: SimProcess, cell_file: Path):
    key = RmwNaming(3).key("joint_states", encoding.JOINT_STATE)
    with socket.create_server(("127.0.0.1", 0)) as probe:
        apart = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    options = ("--rmw-zenoh", "--domain", "3", "--camera-rate", "0", "--listen", apart)
    with ros2_process(robot, cell_file, *options), heard(apart, "3/joint_states/**") as (session, samples):
        assert until(lambda: len(samples) > 10)
        assert not list(session.get("cell/state", timeout=1.0)), "the robot's own messages are elsewhere"
        tokens = [str(r.ok.key_expr) for r in session.liveliness().get("@ros2_lv/3/**") if r.ok is not None]
    assert {str(s.key_expr) for s in samples} == {key}
    numbers = [int.from_bytes(s.attachment.to_bytes()[:8], "little") for s in samples]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    senders = {s.attachment.to_bytes()[17:] for s in samples}
    assert len(senders) == 1
    assert any("/NN/" in t for t in tokens) and any("/MP/%/%/replan/%joint_states/" in t for t in tokens)


def test_a_recording_is_complete_after_ctrl_c(robot: SimProcess, cell_file: Path, tmp_path: Path):
    out = tmp_path / "out.mcap"
    with (
        ros2_process(robot, cell_file, "--mcap", str(out), "--camera-rate", "5") as process,
        heard(robot.endpoint, "*/**") as (_, samples),
        CellClient.connect(robot.endpoint) as client,
    ):
        motion = from_here(client, 0.5, 0.05)
        client.execute(motion, certificate(motion))
        wanted = {"executing_trajectory", "front/color/image_raw"}
        assert until(lambda: wanted <= {str(s.key_expr) for s in samples})
        process.send_signal(signal.SIGINT)
        assert process.wait() == 0
    with out.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None and reader.get_header().profile == "ros2"
        assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
        messages = [
            SimpleNamespace(topic=c.topic, at=m.log_time, content=d) for _, c, m, d in reader.iter_decoded_messages()
        ]
    topics = {m.topic for m in messages}
    assert {"/joint_states", "/tf", "/tf_static", "/executing_trajectory", "/front/color/image_raw"} <= topics
    (played,) = [m.content for m in messages if m.topic == "/executing_trajectory"]
    np.testing.assert_array_equal(played.points[-1].positions, motion.q[-1])


def test_a_killed_recording_is_read_up_to_its_last_chunk(robot: SimProcess, cell_file: Path, tmp_path: Path):
    out = tmp_path / "out.mcap"
    with ros2_process(robot, cell_file, "--mcap", str(out), "--camera-rate", "0") as process:
        assert until(lambda: out.stat().st_size > 10_000)
        process.kill()
        process.wait()
    stamps = []
    with out.open("rb") as file:
        decoders: dict = {}
        schemas, channels = {}, {}
        try:
            record: Any
            for record in StreamReader(file).records:
                kind = type(record).__name__
                if kind == "Schema":
                    schemas[record.id] = record
                elif kind == "Channel":
                    channels[record.id] = record
                elif kind == "Message" and channels[record.channel_id].topic == "/joint_states":
                    schema = schemas[channels[record.channel_id].schema_id]
                    decoder = decoders.setdefault(schema.id, DecoderFactory().decoder_for("cdr", schema))
                    stamps.append(decoder(record.data).header.stamp.sec)
        except Exception as error:  # where it was cut off
            assert "EOF" in type(error).__name__ or "EndOfFile" in type(error).__name__, error
    assert len(stamps) > 20


def test_wrong_options_and_another_cell_are_named(robot: SimProcess, tmp_path: Path):
    with pytest.raises(ConfigError, match=r"--camera-rate -1 is not valid"):
        show_ros2(Ros2Options(robot="tcp/127.0.0.1:1", camera_rate=-1.0), print)
    with pytest.raises(ConfigError, match=r"--domain 500 is not valid; ROS_DOMAIN_ID is 0 to 232"):
        show_ros2(Ros2Options(robot="tcp/127.0.0.1:1", domain=500), print)
    with pytest.raises(ConfigError, match=r"--namespace 'a b' is not valid"):
        show_ros2(Ros2Options(robot="tcp/127.0.0.1:1", namespace="a b"), print)
    with pytest.raises(ConfigError, match=r"serves cell 'test', which is not built in; say --cell FILE"):
        show_ros2(Ros2Options(robot=robot.endpoint), print)
    with pytest.raises(ConfigError, match=r"serves cell 'test', not 'cubes'; say --cell test"):
        show_ros2(Ros2Options(robot=robot.endpoint, cell="cubes"), print)
