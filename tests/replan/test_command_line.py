"""What a person meets who types something wrong: one line, the right exit code, and nothing moves."""

import json
import socket

import cv2
import numpy as np
import pytest

from perception.frames import CameraIntrinsics, RgbdFrame
from perception.recordings.opening import save_npz
from tests.support.typed_commands import one_line_reason, replan


def test_an_empty_goal_is_a_usage_error(tmp_path):
    process = replan("run", "  ", cwd=tmp_path)
    assert process.returncode == 2
    assert "the goal is empty; say what to reach" in one_line_reason(process)


def test_a_motion_speed_that_was_not_judged_is_a_usage_error(tmp_path):
    for speed in ("0", "1.2", "nan"):
        process = replan("run", "place the red cube on the crate", "--motion-speed", speed, cwd=tmp_path)
        assert process.returncode == 2
        assert f"--motion-speed {speed} is not valid; it must be above 0 and at most 1" in one_line_reason(process)


def test_an_unknown_cell_lists_the_built_in_ones(tmp_path):
    process = replan("run", "place the red cube on the crate", "--cell", "kitchen", cwd=tmp_path)
    assert process.returncode == 2
    reason = one_line_reason(process)
    assert "kitchen" in reason
    for name in ("cubes", "cubes-blocked", "fruit-bowl"):
        assert name in reason


def test_a_cell_file_with_an_unknown_key_names_the_key_and_the_file(tmp_path):
    (tmp_path / "mine.yaml").write_text("name: mine\ncolour_of_walls: blue\n")
    process = replan("run", "place the red cube on the crate", "--cell", "mine.yaml", cwd=tmp_path)
    assert process.returncode == 2
    assert "colour_of_walls" in one_line_reason(process)
    assert "mine.yaml" in one_line_reason(process)


def test_no_robot_at_the_named_endpoint_is_said(tmp_path):
    process = replan("run", "place the red cube on the crate", "--robot", "tcp/127.0.0.1:9", cwd=tmp_path)
    assert process.returncode == 1
    assert "tcp/127.0.0.1:9" in one_line_reason(process)


def test_an_error_with_json_is_an_object_on_stdout(tmp_path):
    process = replan("run", "", "--json", cwd=tmp_path)
    assert json.loads(process.stdout)["error"] == "GoalError"


@pytest.mark.parametrize("arguments", [["fly"], ["run"], ["run", "goal", "--speed", "fast"], ["bench", "goals", "--x"]])
def test_wrong_usage_exits_with_two(arguments, tmp_path):
    assert replan(*arguments, cwd=tmp_path).returncode == 2


def test_help_of_every_command_is_shown(tmp_path):
    for command in ("run", "perceive", "robot", "doctor", "bench"):
        process = replan(command, "--help", cwd=tmp_path)
        assert process.returncode == 0
        assert "usage: replan" in process.stdout


def test_rendering_that_does_not_load_is_one_line_with_what_to_install(tmp_path):
    process = replan("run", "place the red cube on the crate", cwd=tmp_path, MUJOCO_GL="osmesa", PYOPENGL_PLATFORM="")
    assert process.returncode == 1
    assert "apt-get install libegl1" in one_line_reason(process)


def test_two_simulated_cells_on_one_port_are_told_apart(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        process = replan("robot", "sim", "--endpoint", f"tcp/127.0.0.1:{port}", cwd=tmp_path)
    assert process.returncode == 1
    assert f"port {port} is in use" in one_line_reason(process)


def test_a_frame_without_depth_and_one_of_the_wrong_size_are_named(tmp_path):
    intrinsics = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    blind = RgbdFrame(np.zeros((48, 64, 3), np.uint8), np.full((48, 64), np.nan), intrinsics, np.eye(4), 0.0)
    save_npz(tmp_path / "blind.npz", [blind])
    process = replan("perceive", "blind.npz", "--names", "red_cube", cwd=tmp_path)
    assert process.returncode == 1
    assert "has no valid depth at all" in one_line_reason(process)

    folder = tmp_path / "pairs"
    folder.mkdir()
    cv2.imwrite(str(folder / "a-color.png"), np.zeros((48, 64, 3), np.uint8))
    cv2.imwrite(str(folder / "a-depth.png"), np.full((24, 32), 500, np.uint16))
    (folder / "camera.yaml").write_text(
        "{width: 64, height: 48, fx: 60, fy: 60, cx: 31.5, cy: 23.5, depth_scale: 0.001}"
    )
    process = replan("perceive", "pairs", "--names", "red_cube", cwd=tmp_path)
    assert process.returncode == 1
    assert "a-depth.png' is 32x24; the intrinsics file says 64x48" in one_line_reason(process)
