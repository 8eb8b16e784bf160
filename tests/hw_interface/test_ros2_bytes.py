"""Every message that is written to ROS 2 keeps its bytes, and every type its hash.

`ros2_bytes.json` was written by this project's own encoder of version 0.1.0 (commit 465b15b), which two decoders,
mcap-ros2-support and pycdr2, read alike. The library that encodes now must write the same.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hw_interface.ros2 import encoding
from perception.ros2.messages import camera_info, compressed_image, image, string, transforms, type_hash

KNOWN = json.loads((Path(__file__).parent / "ros2_bytes.json").read_text())
STAMP = 1_700_000_000_250_000_001  # [ns]
NAMES = ("panda_joint1", "j2", "gelenk_ä")
Q = np.array([[0.1, -0.2, 0.3], [np.nan, 1e-300, -np.inf]])
MATRIX = np.array([[610.0, 0.0, 319.5], [0.0, 611.0, 239.5], [0.0, 0.0, 1.0]])
BYTES = np.arange(36, dtype=np.uint8)
MESSAGES = {
    "string": lambda: string("äöü"),
    "string of nothing": lambda: string(""),
    "rgb8": lambda: image(STAMP, "cam", "rgb8", BYTES.reshape(3, 4, 3)),
    "rgb8, every second column": lambda: image(STAMP, "cam", "rgb8", BYTES.reshape(3, 4, 3)[:, ::2]),
    "16UC1": lambda: image(STAMP, "c", "16UC1", np.array([[0, 1, 65535], [256, 2, 3]], np.uint16)),
    "16UC1 of another byte order": lambda: image(STAMP, "c", "16UC1", np.array([[0, 1], [256, 2]], ">u2")),
    "32FC1": lambda: image(STAMP, "camera_optical", "32FC1", np.array([[np.nan, 0.5]], np.float32)),
    "compressed": lambda: compressed_image(STAMP, "cam", "rgb8; png compressed bgr8", b"12345"),
    "lens": lambda: camera_info(STAMP, "cam", 640, 480, MATRIX),
    "transforms": lambda: transforms(
        [(STAMP, "world", "cam", Q[0], np.array([0.0, 0.6, 0.0, 0.8])), (0, "cam", "", -Q[0], np.ones(4))]
    ),
    "no transforms": lambda: transforms([]),
    "joints": lambda: encoding.joint_state(STAMP, "panda_link0", NAMES, Q[0], Q[1], Q[:, 0].repeat(2)[:3]),
    "joints without effort": lambda: encoding.joint_state(STAMP, "base", NAMES, Q[1], Q[0], np.empty(0)),
    "no joints": lambda: encoding.joint_state(STAMP, "", (), np.empty(0), np.empty(0), np.empty(0)),
    "motion": lambda: encoding.joint_trajectory(
        STAMP, "panda_link0", NAMES, np.array([0, 10_000_000_003]), Q, 2 * Q, Q[::-1]
    ),
    "motion without points": lambda: encoding.joint_trajectory(
        STAMP, "b", NAMES, np.empty(0, int), Q[:0], Q[:0], Q[:0]
    ),
    "diagnostics": lambda: encoding.diagnostics(
        STAMP, encoding.ERROR, "replan: robot", "reflex", "panda", {"mode": "reflex", "speed": "", "é": "x"}
    ),
    "diagnostics without values": lambda: encoding.diagnostics(0, encoding.STALE, "a", "", "panda", {}),
    "log": lambda: encoding.log(STAMP, "warn", "replan", "the hand closed on nothing"),
}


def test_nothing_is_built_before_it_is_needed():
    code = "import sys, hw_interface.ros2.view, perception.ros2.mcap_file; print('rosbags' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout == "False\n"


def test_all_known_messages_are_compared():
    assert set(MESSAGES) == set(KNOWN["messages"])


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message_has_the_bytes_that_it_always_had(name: str):
    assert MESSAGES[name]().hex() == KNOWN["messages"][name]


@pytest.mark.parametrize("kind", KNOWN["hashes"])
def test_a_type_has_the_hash_that_it_always_had(kind: str):
    assert type_hash(kind) == KNOWN["hashes"][kind]
