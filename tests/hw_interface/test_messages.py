"""Messages: what comes out is what went in, and nothing malformed gets through."""

import zlib

import msgpack
import numpy as np
import pytest

from benchmarks.robot_side.perfect_robot import blank_frame, certificate, perfect_driver, swing
from control.robot.limits import REST_Q
from control.trajectory.samples import GripperCommand
from hw_interface.errors import MessageError
from hw_interface.messages.frames import FrameMessage
from hw_interface.messages.motions import MotionResult, TrajectoryRequest
from hw_interface.messages.robot import RobotState, SpeedRequest, StopRequest
from hw_interface.messages.wire import MAX_MESSAGE_BYTES, PROTOCOL_VERSION, decode, encode, seal
from tests.support.robot_side.hw_support import joined


def envelope(kind: str, body: object, protocol: int = PROTOCOL_VERSION) -> bytes:
    packed = msgpack.packb(body)
    assert packed is not None
    return seal(kind, packed, protocol)


def trajectory_body() -> dict:
    motion = swing(0.1)
    return msgpack.unpackb(encode(TrajectoryRequest.of(motion, certificate(motion), "a run", "somebody")))["body"]


def test_a_trajectory_arrives_bit_for_bit():
    q = np.array(REST_Q) + np.array([[0.0], [0.1], [0.0]])
    motion = joined(q, [GripperCommand("grasp", 0.04, 30.0), GripperCommand("move", 0.08)], held=(None, "red_cube"))
    sent = certificate(motion)
    received = decode(encode(TrajectoryRequest.of(motion, sent, "a run", "somebody")), TrajectoryRequest)
    assert received.trajectory().content_hash() == motion.content_hash()
    assert received.trajectory().gripper == motion.gripper
    assert received.certificate_or_none() == sent


def test_large_arrays_are_packed_as_msgpack_would_pack_them():
    motion = swing(8.0)
    data = encode(TrajectoryRequest.of(motion, certificate(motion), "a run", "somebody"))
    body = msgpack.unpackb(data)["body"]
    assert data == envelope("trajectory_request", body)
    for name in ("q", "qd", "qdd"):
        assert body[name]["data"] == getattr(motion, name).tobytes()


def test_a_changed_byte_within_a_large_array_is_noticed():
    motion = swing(8.0)
    data = bytearray(encode(TrajectoryRequest.of(motion, certificate(motion), "a run", "somebody")))
    data[len(data) // 2] ^= 1
    with pytest.raises(MessageError, match=r"'crc': .*changed on the way"):
        decode(bytes(data), TrajectoryRequest)


@pytest.mark.parametrize("speed", [None, 0.3, 1.0])
def test_a_trajectory_arrives_with_the_speed_to_play_it_at(speed: float | None):
    motion = swing(0.1)
    request = TrajectoryRequest.of(motion, certificate(motion), "a run", "somebody", speed)
    assert decode(encode(request), TrajectoryRequest).speed == speed


def test_a_result_arrives_with_the_speed_of_every_row():
    driver, _ = perfect_driver()
    motion = swing(0.2, 0.01)
    serial = driver.submit(motion, certificate(motion), 0.5).serial
    while driver.moving:
        driver.tick()
    received = decode(encode(driver.result(serial)), MotionResult)
    np.testing.assert_array_equal(received.speed, driver.result(serial).speed)
    assert len(received.speed) == len(received.times)


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({}, "speed"),
        ({"speed": "fast"}, "speed"),
        ({"speed": True}, "speed"),
        ({"speed": None}, "speed"),
        ({"speed": float("nan")}, "speed"),
        ({"speed": float("inf")}, "speed"),
        ({"speed": 0.5, "ramp": 0.1}, "ramp"),
    ],
)
def test_a_malformed_request_for_a_speed_is_refused_by_field(body: dict, field: str):
    with pytest.raises(MessageError) as caught:
        decode(envelope("speed_request", body), SpeedRequest)
    assert caught.value.field == field


def test_every_flipped_bit_of_a_request_is_noticed():
    data = encode(SpeedRequest(speed=0.5))
    for bit in range(8 * len(data)):
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        with pytest.raises(MessageError):
            decode(bytes(changed), SpeedRequest)


def test_flipped_bits_of_a_trajectory_are_told_as_a_change_on_the_way():
    motion = swing(0.1)
    data = encode(TrajectoryRequest.of(motion, certificate(motion), "a run", "somebody"))
    rng = np.random.default_rng(0)
    for bit in rng.integers(8 * 1000, 8 * len(data), 200):  # behind the first kilobyte there is nothing but the body
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << int(bit) % 8
        with pytest.raises(MessageError, match=r"'crc': .*changed on the way"):
            decode(bytes(changed), TrajectoryRequest)


def test_random_bytes_in_place_of_any_part_of_a_message_are_refused():
    data = encode(SpeedRequest(speed=0.5))
    rng = np.random.default_rng(0)
    for _ in range(300):
        changed = bytearray(data)
        changed[rng.integers(len(data))] = rng.integers(256)
        if bytes(changed) != data:
            with pytest.raises(MessageError):
                decode(bytes(changed), SpeedRequest)


def test_a_message_is_plain_msgpack_with_its_check_sum():
    data = msgpack.unpackb(encode(StopRequest(reason="operator")))
    packed = msgpack.packb({"reason": "operator"})
    assert packed is not None
    assert data == {
        "protocol": PROTOCOL_VERSION,
        "type": "stop_request",
        "crc": zlib.crc32(b"stop_request" + packed),
        "body": {"reason": "operator"},
    }


def test_a_frame_arrives_unchanged_with_its_unknown_depth():
    frame = blank_frame("front")
    depth = frame.depth.copy()
    depth[3, 4] = np.nan
    frame = type(frame)(frame.colour, depth, frame.intrinsics, frame.world_T_camera, frame.stamp, "front")
    received = decode(encode(FrameMessage.of(frame)), FrameMessage).frame()
    np.testing.assert_array_equal(received.depth, depth)
    np.testing.assert_array_equal(received.colour, frame.colour)
    assert (received.intrinsics, received.stamp, received.camera) == (frame.intrinsics, frame.stamp, "front")


def test_a_state_arrives_unchanged():
    driver, _ = perfect_driver()
    state = driver.state()
    assert decode(encode(state), RobotState) == state


@pytest.mark.parametrize(
    "data",
    [
        *(b"", b"\xc1", b"\x00" * 40, b"{}", bytes(range(256)), b"\x80", b"\x84\xa1a\x01"),
        b"\x81\xa8protocol" + bytes([PROTOCOL_VERSION]),
    ],
)
def test_bytes_that_are_no_message_are_refused(data: bytes):
    with pytest.raises(MessageError, match="message field 'message'"):
        decode(data, StopRequest)


def test_every_truncation_of_a_message_is_refused():
    data = encode(StopRequest(reason="operator"))
    for length in range(len(data)):
        with pytest.raises(MessageError):
            decode(data[:length], StopRequest)


def test_another_protocol_version_is_named_with_what_to_do():
    ours, newer = PROTOCOL_VERSION, PROTOCOL_VERSION + 1
    with pytest.raises(MessageError, match=rf"'protocol': version {newer} .*speaks version {ours}.*same release"):
        decode(envelope("stop_request", {"reason": ""}, protocol=newer), StopRequest)
    older = msgpack.packb({"protocol": 2, "type": "stop_request", "body": {"reason": ""}})
    assert older is not None
    with pytest.raises(MessageError, match=rf"'protocol': version 2 .*speaks version {ours}"):
        decode(older, StopRequest)


def test_a_message_of_another_type_is_refused():
    with pytest.raises(MessageError, match="'type': is 'state_request'; 'stop_request' was expected"):
        decode(envelope("state_request", {}), StopRequest)


def test_an_unknown_field_is_named():
    with pytest.raises(MessageError, match="'hurry'"):
        decode(envelope("stop_request", {"reason": "", "hurry": True}), StopRequest)


def test_too_large_a_message_is_refused_before_it_is_parsed():
    with pytest.raises(MessageError, match=f"at most {MAX_MESSAGE_BYTES}"):
        decode(b"\0" * (MAX_MESSAGE_BYTES + 1), StopRequest)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"q": 3}, "q"),
        ({"q": {"dtype": "<f8", "shape": [10, 7], "data": b"\0" * 8}}, "q"),
        ({"q": {"dtype": "<f4", "shape": [1, 7], "data": b"\0" * 28}}, "q"),
        ({"q": {"dtype": "O", "shape": [1, 7], "data": b"\0" * 56}}, "q"),
        ({"qd": {"dtype": "<f8", "shape": [-1, 7], "data": b""}}, "qd"),
        ({"qd": {"dtype": "<f8", "shape": [2**62, 2**62], "data": b""}}, "qd"),
        ({"qdd": {"dtype": "<f8", "shape": [2, 7], "data": np.full(14, np.nan).tobytes()}}, "qdd"),
        ({"joint_names": ["a"] * 7}, "joint_names"),
        ({"gripper": [{"time": -1.0, "dwell": 0.1, "kind": "move", "width": 0.0, "force": 0.0}]}, "gripper.0.time"),
        ({"gripper": [{"time": 0.0, "dwell": 0.1, "kind": "crush", "width": 0.0, "force": 0.0}]}, "gripper.0.kind"),
        ({"certificate": {}}, "certificate.serial"),
        ({"speed": "0.5"}, "speed"),
        ({"speed": float("nan")}, "speed"),
        ({"certificate": {"expires": float("inf")}}, "certificate"),
    ],
)
def test_a_malformed_field_of_a_trajectory_is_named(change: dict, field: str):
    with pytest.raises(MessageError) as caught:
        decode(envelope("trajectory_request", trajectory_body() | change), TrajectoryRequest).trajectory()
    assert caught.value.field.startswith(field)


def test_arrays_of_different_lengths_are_no_trajectory():
    body = trajectory_body()
    body["qd"] = {"dtype": "<f8", "shape": [3, 7], "data": np.zeros(21).tobytes()}
    with pytest.raises(MessageError, match=r"qd has shape \(3, 7\), q has \(101, 7\)"):
        decode(envelope("trajectory_request", body), TrajectoryRequest).trajectory()
