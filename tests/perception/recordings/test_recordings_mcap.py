"""ROS 2 recordings of cameras: every encoding, pairing by stamps, transforms, and all that may be wrong with a file."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.errors import FrameError
from perception.recordings.opening import McapChoice, open_recording
from tests.support.robot_side.ros2_cameras import OPTICAL, compressed, image, info, png, quantised_depth, tf
from tests.support.robot_side.ros2_messages import write_mcap

COLOUR, DEPTH, INFO = "/cam/color/image_raw", "/cam/aligned_depth_to_color/image_raw", "/cam/color/camera_info"
WIDTH, HEIGHT = 8, 6
RNG = np.random.default_rng(3)
RGB = RNG.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
MM = RNG.integers(300, 2000, (HEIGHT, WIDTH)).astype(np.uint16)
MM[0, 0] = 0
METRES = np.where(MM > 0, MM / 1000, np.nan).astype(np.float32)
STATIC = tf(0.0, "world", OPTICAL, (1.0, 2.0, 3.0), topic="/tf_static")


def colour(stamp, topic=COLOUR, **more):
    return image(topic, stamp, "rgb8", RGB, **more)


def depth(stamp, topic=DEPTH, **more):
    return image(topic, stamp, "16UC1", MM, **more)


def camera_info(topic=INFO, **more):
    return info(topic, WIDTH, HEIGHT, **more)


def written(tmp_path, *messages, **options):
    return write_mcap(tmp_path / "camera.mcap", messages, **options)


def plain(tmp_path, stamps=(1.0,), **options):
    pairs = [m for s in stamps for m in (colour(s), depth(s))]
    return written(tmp_path, camera_info(), STATIC, *pairs, **options)


def test_a_recording_becomes_frames_with_lens_pose_stamp_and_the_cameras_name(tmp_path):
    recording = open_recording(plain(tmp_path, (1.0, 1.5)))
    first, second = recording
    assert np.array_equal(first.colour, RGB)
    assert np.allclose(first.depth, METRES, equal_nan=True, atol=1e-6)
    assert (first.intrinsics.fx, first.intrinsics.fy, first.intrinsics.cx) == (10.0, 11.0, 3.5)
    assert first.world_T_camera[:3, 3].tolist() == [1.0, 2.0, 3.0]
    assert (first.stamp, second.stamp, first.camera) == (1.0, 1.5, "cam")
    assert recording.name == "camera.mcap" and recording.count is None and recording.skipped == []
    assert recording.notes[-1] == "the world is the frame 'world'"
    assert not recording.has_truth and [t.truth for t in recording.with_truth()] == [None, None]


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", RGB),
        ("bgr8", RGB[:, :, ::-1]),
        ("rgba8", np.dstack([RGB, RGB[:, :, 0]])),
        ("bgra8", np.dstack([RGB[:, :, ::-1], RGB[:, :, 0]])),
    ],
)
@pytest.mark.parametrize("pad", [0, 5])
def test_colour_of_every_encoding_is_the_same_picture_with_and_without_padded_rows(tmp_path, encoding, pixels, pad):
    (frame,) = open_recording(
        written(tmp_path, camera_info(), STATIC, image(COLOUR, 1.0, encoding, pixels, pad=pad), depth(1.0))
    )
    assert np.array_equal(frame.colour, RGB)


def test_a_grey_picture_is_the_same_in_all_three_colours(tmp_path):
    grey = image("/cam/color/image", 1.0, "mono8", RGB[:, :, 0])
    (frame,) = open_recording(written(tmp_path, camera_info(), STATIC, grey, depth(1.0)))
    assert np.array_equal(frame.colour, np.repeat(RGB[:, :, :1], 3, axis=2))


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("pad", [0, 6])
@pytest.mark.parametrize(("encoding", "pixels"), [("16UC1", MM), ("mono16", MM), ("32FC1", METRES)])
def test_depth_of_every_encoding_and_byte_order_is_in_metres(tmp_path, encoding, pixels, big, pad):
    picture = image(DEPTH, 1.0, encoding, pixels, big=big, pad=pad)
    (frame,) = open_recording(written(tmp_path, camera_info(), STATIC, colour(1.0), picture))
    assert np.allclose(frame.depth, METRES, equal_nan=True, atol=1e-6)


def test_hidden_too_near_and_too_far_depths_are_unknown(tmp_path):
    stereo = np.full((HEIGHT, WIDTH), 0.7, np.float32)
    stereo[0, :4] = np.nan, np.inf, -np.inf, -1.0
    (frame,) = open_recording(written(tmp_path, camera_info(), STATIC, colour(1.0), image(DEPTH, 1.0, "32FC1", stereo)))
    assert np.isnan(frame.depth[0, :4]).all() and np.isnan(frame.depth).sum() == 4


def test_compressed_pictures_are_read(tmp_path):
    smooth = np.full((HEIGHT, WIDTH, 3), (40, 120, 200), np.uint8)
    for form, ending in (("png", ".png"), ("rgb8; jpeg compressed bgr8", ".jpg")):
        picture = compressed(COLOUR + "/compressed", 1.0, form, png(smooth[:, :, ::-1], ending))
        header = b"\0" * 12
        deep = compressed(DEPTH + "/compressedDepth", 1.0, "16UC1; compressedDepth png", header + png(MM))
        (frame,) = open_recording(written(tmp_path, camera_info(), STATIC, picture, deep))
        assert np.abs(frame.colour.astype(int) - smooth).max() <= (0 if form == "png" else 3)
        assert np.allclose(frame.depth, METRES, equal_nan=True, atol=1e-6)


def test_depth_that_was_quantised_as_inverse_comes_back_in_metres(tmp_path):
    deep = compressed(DEPTH + "/compressedDepth", 1.0, "32FC1; compressedDepth", quantised_depth(METRES, 1e4, 20.0))
    (frame,) = open_recording(written(tmp_path, camera_info(), STATIC, colour(1.0), deep))
    # One step of the inverse is z^2 / 1e4 = 0.4 mm at 2 m.
    assert np.allclose(frame.depth, METRES, equal_nan=True, atol=3e-4)


def test_colour_and_depth_are_paired_within_the_tolerance_and_lonely_ones_are_named(tmp_path):
    file = written(
        tmp_path, camera_info(), STATIC, colour(1.0), depth(1.015), colour(1.1), depth(1.14), colour(1.2), depth(1.205)
    )
    recording = open_recording(file)
    assert [f.stamp for f in recording] == [1.0, 1.2]
    assert [s.where for s in recording.skipped] == [f"message 1 of topic '{COLOUR}'", f"message 1 of topic '{DEPTH}'"]
    assert recording.skipped[0].reason == "no depth picture within 20 ms; the nearest is 40.0 ms away"
    assert len(list(open_recording(file, mcap=McapChoice(tolerance=0.05)))) == 3
    list(recording)
    assert len(recording.skipped) == 2, "a new iteration counts anew"


def test_a_depth_picture_goes_to_the_nearest_colour_picture(tmp_path):
    recording = open_recording(
        written(tmp_path, camera_info(), STATIC, colour(1.0), depth(1.018), colour(1.02), colour(1.04), depth(1.041))
    )
    assert [f.stamp for f in recording] == [1.02, 1.04]


def test_pictures_that_come_late_find_their_partners(tmp_path):
    stamps = [1.0, 1.1, 1.2, 1.3]
    file = written(tmp_path, camera_info(), STATIC, *[colour(s) for s in stamps], *[depth(s) for s in stamps])
    assert [f.stamp for f in open_recording(file)] == stamps


def test_the_pose_is_interpolated_along_the_chain_of_transforms(tmp_path):
    up = Rotation.from_euler("z", 90, degrees=True).as_quat()
    optical = Rotation.from_euler("xyz", [-90, 0, -90], degrees=True).as_quat()
    (frame,) = open_recording(
        written(
            tmp_path,
            camera_info(),
            tf(0.9, "panda_link0", "hand", (0.0, 0.0, 0.0)),
            tf(0.0, "hand", OPTICAL, (0.1, 0.0, 0.0), optical, topic="/tf_static"),
            colour(1.0),
            depth(1.0),
            tf(1.1, "panda_link0", "hand", (0.4, 0.0, 0.2), up),
        )
    )
    half = np.eye(4)
    half[:3, :3], half[:3, 3] = Rotation.from_euler("z", 45, degrees=True).as_matrix(), (0.2, 0.0, 0.1)
    mount = np.eye(4)
    mount[:3, :3], mount[:3, 3] = Rotation.from_quat(optical).as_matrix(), (0.1, 0.0, 0.0)
    assert np.allclose(frame.world_T_camera, half @ mount, atol=1e-6)


def test_a_picture_without_a_transform_at_its_time_is_left_out(tmp_path):
    moving = [tf(1.0 + 0.1 * k, "world", OPTICAL, (0.1 * k, 0.0, 0.0)) for k in range(3)]
    recording = open_recording(
        written(tmp_path, camera_info(), *moving, colour(1.1), depth(1.1), colour(3.0), depth(3.0))
    )
    assert [f.stamp for f in recording] == [1.1]
    assert (
        "no transform of 'cam_optical' within 0.1 s of the picture at 3.000 s: they go from 1.000 to 1.200"
        in recording.skipped[0].reason
    )


def test_nothing_is_interpolated_across_a_gap_in_which_the_camera_moved(tmp_path):
    ends = [tf(1.0, "world", OPTICAL), tf(4.0, "world", OPTICAL, (1.0, 0.0, 0.0))]
    recording = open_recording(
        written(tmp_path, camera_info(), *ends, colour(2.0), depth(2.0), colour(4.0), depth(4.0))
    )
    assert [f.stamp for f in recording] == [4.0]
    assert "of the picture at 2.000 s: they jump from 1.000 s on" in recording.skipped[0].reason


def test_a_fixed_camera_may_be_published_once_among_the_moving_transforms(tmp_path):
    (frame,) = open_recording(
        written(tmp_path, camera_info(), tf(1.0, "map", OPTICAL, (1.0, 0.0, 0.0)), colour(60.0), depth(60.0))
    )
    assert frame.world_T_camera[0, 3] == 1.0


def tilted_plane():
    """Depth of a plane half a metre below a camera that looks 45 degrees down, 64 x 48, in [m]."""
    v, _ = np.mgrid[0:48, 0:64]
    slope = (v - 23.5) / 60.0
    return (0.5 / (np.sin(np.pi / 4) + slope * np.cos(np.pi / 4))).astype(np.float32)


def tilted_recording(tmp_path, *transforms):
    k = {"k": [60.0, 0, 31.5, 0, 60.0, 23.5, 0, 0, 1.0], "p": [60.0, 0, 31.5, 0, 0, 60.0, 23.5, 0, 0, 0, 1.0, 0]}
    flat = image(DEPTH, 1.0, "32FC1", tilted_plane())
    grey = image(COLOUR, 1.0, "mono8", np.zeros((48, 64), np.uint8))
    return written(tmp_path, info(INFO, 64, 48, OPTICAL, **k), *transforms, grey, flat)


def test_without_transforms_the_plane_that_things_stand_on_is_the_world(tmp_path):
    recording = open_recording(tilted_recording(tmp_path))
    (frame,) = recording
    assert frame.world_T_camera[2, 3] == pytest.approx(0.5, abs=2e-3)
    assert recording.notes[-1].endswith("found in each frame: it has no transforms")


def test_frames_that_are_no_world_are_named_and_may_be_chosen(tmp_path):
    file = tilted_recording(tmp_path, tf(0.0, "odom", OPTICAL, (0.0, 0.0, 9.0), topic="/tf_static"))
    assert "the cameras hang on odom, none of world, map, panda_link0" in open_recording(file).notes[-1]
    (frame,) = open_recording(file, mcap=McapChoice(world="odom"))
    assert frame.world_T_camera[2, 3] == 9.0
    with pytest.raises(
        FrameError, match=r"no transform leads from the world 'lab' to camera 'cam'; .* cam_optical, odom"
    ):
        open_recording(file, mcap=McapChoice(world="lab"))


def test_several_cameras_come_with_their_own_names_and_can_be_chosen(tmp_path):
    messages = [
        m
        for name in ("left_arm", "static")
        for m in (
            colour(1.0, f"/{name}/color/image_raw", frame=name),
            depth(1.0, f"/{name}/aligned_depth_to_color/image_raw", frame=name),
            camera_info(f"/{name}/color/camera_info", frame=name),
            tf(0.0, "world", name, topic="/tf_static"),
        )
    ]
    file = written(tmp_path, *messages)
    assert {f.camera for f in open_recording(file)} == {"left_arm", "static"}
    assert [f.camera for f in open_recording(file, mcap=McapChoice(cameras=("static",)))] == ["static"]
    with pytest.raises(FrameError, match="there is no camera 'top'; there are left_arm, static"):
        open_recording(file, mcap=McapChoice(cameras=("top",)))


def test_topics_that_could_all_be_meant_are_listed_with_their_types_and_can_be_named(tmp_path):
    file = written(tmp_path, camera_info(), STATIC, colour(1.0), colour(1.0, "/cam/color/image_other_raw"), depth(1.0))
    with pytest.raises(FrameError) as caught:
        open_recording(file)
    text = str(caught.value)
    assert "several topics fit: " in text and text.endswith("choose one with --colour-topic")
    assert f"'{COLOUR}' (sensor_msgs/msg/Image, colour 8x6 in frame '{OPTICAL}')" in text
    assert "'/cam/color/image_other_raw'" in text
    assert len(list(open_recording(file, mcap=McapChoice(colour=COLOUR)))) == 1


def test_rectified_colour_depth_that_is_registered_and_raw_messages_are_preferred(tmp_path):
    """The topics of a ZED and, in another frame, of a RealSense's infrared cameras."""
    file = written(
        tmp_path,
        camera_info("/zed/rgb/camera_info"),
        camera_info("/zed/left/camera_info"),
        STATIC,
        *[
            colour(1.0, f"/zed/{t}")
            for t in ("rgb/image_rect_color", "left/image_rect_color", "rgb_raw/image_raw_color")
        ],
        compressed("/zed/rgb/image_rect_color/compressed", 1.0, "jpeg", png(RGB, ".jpg")),
        *[image(f"/zed/{t}", 1.0, "32FC1", METRES) for t in ("depth/depth_registered", "confidence/confidence_map")],
        image("/zed/infra1/image_rect_raw", 1.0, "mono8", RGB[:, :, 0], frame="infra"),
        depth(1.0, "/zed/depth/image_rect_raw", frame="infra"),
    )
    assert (
        open_recording(file).notes[0] == "camera 'zed': /zed/rgb/image_rect_color with /zed/depth/depth_registered, 8x6"
    )


def test_a_topic_that_is_not_there_or_of_another_kind_is_refused(tmp_path):
    file = plain(tmp_path)
    with pytest.raises(FrameError, match="no topic '/other' for --depth-topic with a message that can be read; it has"):
        open_recording(file, mcap=McapChoice(depth="/other"))
    with pytest.raises(FrameError, match=rf"the topic '{COLOUR}' .* is no depth picture"):
        open_recording(file, mcap=McapChoice(depth=COLOUR))


def test_depth_of_another_frame_is_refused_with_how_to_register_it_unless_both_are_named(tmp_path):
    file = written(tmp_path, camera_info(), STATIC, colour(1.0), depth(1.0, frame="depth_optical"))
    with pytest.raises(FrameError, match=r"no depth is of the same frame and size .* align_depth.enable:=true"):
        open_recording(file)
    recording = open_recording(file, mcap=McapChoice(colour=COLOUR, depth=DEPTH))
    assert len(list(recording)) == 1
    assert "depth is of frame 'depth_optical', colour of 'cam_optical'; taken as registered" in recording.notes[1]


def test_depth_of_another_size_is_refused_with_both_sizes(tmp_path):
    small = image(DEPTH, 1.0, "16UC1", MM[:3])
    file = written(tmp_path, camera_info(), STATIC, colour(1.0), small)
    with pytest.raises(FrameError, match="no depth is of the same frame and size as a colour picture"):
        open_recording(file)
    with pytest.raises(FrameError, match=r"colour and depth differ in size: .* 8x6 .* 8x3 "):
        open_recording(file, mcap=McapChoice(colour=COLOUR, depth=DEPTH))


def test_a_recording_without_depth_says_what_it_has(tmp_path):
    with pytest.raises(FrameError, match=rf"there is no depth picture in the recording; it has '{COLOUR}'"):
        open_recording(written(tmp_path, camera_info(), colour(1.0)))
    with pytest.raises(FrameError, match="there is no colour picture in the recording; it has no pictures"):
        open_recording(written(tmp_path, STATIC))


def test_a_missing_camera_info_is_named_and_an_intrinsics_file_takes_its_place(tmp_path):
    file = written(tmp_path, STATIC, colour(1.0), depth(1.0))
    with pytest.raises(FrameError, match=rf"'{INFO}' \(sensor_msgs/msg/CameraInfo\) is not in the recording; name one"):
        open_recording(file)
    lens = tmp_path / "lens.yaml"
    lens.write_text("{width: 8, height: 6, fx: 20, fy: 20, cx: 3.5, cy: 2.5}")
    (frame,) = open_recording(file, intrinsics=lens)
    assert frame.intrinsics.fx == 20


def test_a_camera_that_was_never_calibrated_is_refused(tmp_path):
    file = written(tmp_path, camera_info(k=[0.0] * 9), STATIC, colour(1.0), depth(1.0))
    with pytest.raises(FrameError, match=r"its CameraInfo is not calibrated \(fx 0, fy 0\); say --intrinsics"):
        list(open_recording(file))


def test_a_rectified_picture_goes_by_the_projection_matrix(tmp_path):
    p = [20.0, 0.0, 3.0, 0.0, 0.0, 21.0, 2.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    messages = (camera_info("/cam/color/camera_info", p=p, d=[0.1] * 5), STATIC, depth(1.0))
    (frame,) = open_recording(written(tmp_path, *messages, colour(1.0, "/cam/color/image_rect")))
    assert (frame.intrinsics.fx, frame.intrinsics.cx) == (20.0, 3.0)
    assert np.array_equal(frame.colour, RGB)


def test_a_distorted_picture_is_made_straight(tmp_path):
    """A bright dot where the lens puts the ray (0.3, 0) lands where a pinhole would put it."""
    k1, ray = 0.5, 0.3
    k = [100.0, 0, 50.0, 0, 100.0, 40.0, 0, 0, 1.0]
    seen = round(50 + 100 * ray * (1 + k1 * ray**2)), 40
    grey, deep = np.zeros((81, 101), np.uint8), np.full((81, 101), 1000, np.uint16)
    grey[seen[1] - 1 : seen[1] + 2, seen[0] - 1 : seen[0] + 2] = 255
    deep[seen[1] - 1 : seen[1] + 2, seen[0] - 1 : seen[0] + 2] = 500
    lens = info(INFO, 101, 81, k=[float(v) for v in k], d=[k1, 0.0, 0.0, 0.0, 0.0])
    (frame,) = open_recording(
        written(tmp_path, lens, STATIC, image(COLOUR, 1.0, "mono8", grey), image(DEPTH, 1.0, "16UC1", deep))
    )
    assert frame.colour[40, 80, 0] > 200 and frame.depth[40, 80] == pytest.approx(0.5)
    assert frame.colour[seen[1], seen[0] + 1, 0] < 100


def test_a_distortion_of_an_unknown_model_is_refused(tmp_path):
    lens = camera_info(distortion_model="equidistant", d=[0.1] * 4)
    with pytest.raises(FrameError, match=r"4 coefficients of the model 'equidistant'; .* rectify the pictures first"):
        list(open_recording(written(tmp_path, lens, STATIC, colour(1.0), depth(1.0))))


def test_whole_numbered_depth_may_be_in_another_unit_and_metres_may_not(tmp_path):
    (frame,) = open_recording(plain(tmp_path), depth_scale=0.0001)
    assert np.nanmax(frame.depth) == pytest.approx(np.nanmax(METRES) / 10)
    file = written(tmp_path, camera_info(), STATIC, colour(1.0), image(DEPTH, 1.0, "32FC1", METRES))
    with pytest.raises(FrameError, match=rf"the depth of '{DEPTH}' is in metres already; leave out --depth-scale"):
        open_recording(file, depth_scale=0.0001)
    with pytest.raises(FrameError, match="a depth scale of -1 is not valid"):
        open_recording(plain(tmp_path), depth_scale=-1.0)


def broken(kind):
    topic, _, content = colour(1.1)
    if kind == "short":
        return (topic, "sensor_msgs/msg/Image", {**content, "data": content["data"][:20]}), "it has 20 bytes; 6 rows"
    if kind == "rows":
        return (
            topic,
            "sensor_msgs/msg/Image",
            {**content, "step": 3},
        ), "its rows have 3 bytes; 8 pixels of rgb8 need 24"
    return (
        topic,
        "sensor_msgs/msg/Image",
        {**content, "encoding": "yuv422"},
    ), "its encoding is 'yuv422'; colour is one"


@pytest.mark.parametrize("kind", ["short", "rows", "encoding"])
def test_a_broken_picture_in_the_middle_is_left_out_counted_and_named(tmp_path, kind):
    message, reason = broken(kind)
    recording = open_recording(
        written(tmp_path, camera_info(), STATIC, colour(1.0), depth(1.0), message, depth(1.1), colour(1.2), depth(1.2))
    )
    assert [f.stamp for f in recording] == [1.0, 1.2]
    (skipped,) = recording.skipped
    assert skipped.where == f"message 1 of topic '{COLOUR}'" and skipped.reason.startswith(reason)


@pytest.mark.parametrize("ending", [".jpg", ".png"])
def test_a_compressed_picture_that_is_cut_off_is_left_out_instead_of_filled_with_grey(tmp_path, ending):
    whole = png(np.repeat(np.repeat(RGB, 8, 0), 8, 1), ending)
    deep = [image(DEPTH, s, "16UC1", np.repeat(np.repeat(MM, 8, 0), 8, 1)) for s in (1.0, 1.1)]
    pictures = [
        compressed(COLOUR + "/compressed", s, ending[1:], d) for s, d in ((1.0, whole), (1.1, whole[: len(whole) // 2]))
    ]
    recording = open_recording(written(tmp_path, info(INFO, 64, 48), STATIC, *pictures, *deep))
    assert [f.stamp for f in recording] == [1.0]
    assert f"cut off after {len(whole) // 2} bytes" in recording.skipped[0].reason


def test_a_recording_of_which_no_frame_can_be_used_says_why(tmp_path):
    pairs = [m for s in (1.0, 2.0) for m in (image(COLOUR, s, "rgb8", RGB), image(DEPTH, s, "16UC1", MM))]
    for topic, _, content in pairs:
        if topic == DEPTH:
            content["data"] = content["data"][:10]
    recording = open_recording(written(tmp_path, camera_info(), STATIC, *pairs))
    with pytest.raises(
        FrameError,
        match=rf"no frame of 'camera.mcap' can be used \(2 left out\); first message 0 of topic '{DEPTH}': it has 10 ",
    ):
        list(recording)


def test_a_topic_of_which_nothing_can_be_read_is_named_with_the_reason(tmp_path):
    pictures = [compressed(COLOUR + "/compressed", 1.0 + k, "jpeg", b"no picture") for k in range(5)]
    file = written(tmp_path, camera_info(), STATIC, *pictures, depth(1.0))
    with pytest.raises(FrameError, match=r"there is no colour picture .*; message 0 of topic '.*': it cannot be read"):
        open_recording(file)


def many(tmp_path):
    """Ten pairs, a chunk for each message."""
    return plain(tmp_path, [1.0 + k for k in range(10)], chunk_size=100)


def test_a_damaged_chunk_is_left_out_and_named_and_reading_goes_on_behind_it(tmp_path):
    file = many(tmp_path)
    data = bytearray(file.read_bytes())
    at = len(data) // 3
    data[at : at + 40] = b"\xff" * 40
    file.write_bytes(data)
    recording = open_recording(file)
    frames = list(recording)
    assert 7 <= len(frames) <= 9 and frames[-1].stamp == 10.0
    assert any(s.where.startswith("bytes ") and "of the file" in s.where for s in recording.skipped)


def test_a_file_that_was_cut_off_is_read_up_to_its_end(tmp_path):
    file = many(tmp_path)
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 3])
    recording = open_recording(file)
    frames = list(recording)
    assert frames[0].stamp == 1.0 and 2 <= len(frames) < 10
    assert any("the file is cut off there" in s.reason for s in recording.skipped)


@pytest.mark.parametrize("damage", range(8))
def test_whatever_is_damaged_leads_to_frames_or_to_a_frame_error(tmp_path, damage):
    file = many(tmp_path)
    rng, data = np.random.default_rng(damage), bytearray(file.read_bytes())
    for _ in range(30):
        data[int(rng.integers(8, len(data)))] = int(rng.integers(0, 256))
    file.write_bytes(data)
    try:
        recording = open_recording(file)
        frames = list(recording)
    except FrameError:
        return
    assert len(frames) + len(recording.skipped) > 0


def test_a_file_that_is_no_mcap_is_refused(tmp_path):
    (tmp_path / "text.mcap").write_text("no such thing")
    with pytest.raises(FrameError, match="is not an MCAP file: it does not begin like one"):
        open_recording(tmp_path / "text.mcap")


def test_options_of_other_formats_are_refused(tmp_path):
    with pytest.raises(FrameError, match="has no use for --models: an MCAP file"):
        open_recording(plain(tmp_path), models=tmp_path)
    with pytest.raises(FrameError, match=r"a tolerance of -1 s is not valid"):
        open_recording(plain(tmp_path), mcap=McapChoice(tolerance=-1.0))


def test_a_bags_folder_is_its_file_and_one_of_several_is_asked_for(tmp_path):
    plain(tmp_path)
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    assert len(list(open_recording(tmp_path))) == 1
    (tmp_path / "camera_1.mcap").write_bytes((tmp_path / "camera.mcap").read_bytes())
    with pytest.raises(FrameError, match=r"it holds 2 MCAP files, 'camera.mcap', 'camera_1.mcap'; name one of them"):
        open_recording(tmp_path)


def test_bags_of_other_formats_are_to_be_converted(tmp_path):
    (tmp_path / "x.db3").write_bytes(b"SQLite format 3")
    with pytest.raises(FrameError, match=r"is a bag of another format; convert it to MCAP, see docs/recordings.md"):
        open_recording(tmp_path / "x.db3")
