"""Recorded frames: folders of PNG pairs, the project's .npz, real pictures, and what is wrong with a bad one."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from perception.errors import FrameError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.interfaces import Detection
from perception.pipeline import Perception, default_perception
from perception.recordings.opening import open_recording, save_npz

REAL_FRAMES = Path(__file__).resolve().parents[4] / "shared" / "data" / "real_rgbd"
INTRINSICS = "{width: 8, height: 6, fx: 10, fy: 10, cx: 3.5, cy: 2.5, depth_scale: 0.0005, world_T_camera: %s}"
IDENTITY = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"


@pytest.fixture
def folder(tmp_path):
    """One pair with an intrinsics file; red on the left, one depth of 1 m and the rest unknown."""
    colour, depth = np.zeros((6, 8, 3), np.uint8), np.zeros((6, 8), np.uint16)
    colour[:, :4, 2] = 255  # OpenCV writes blue first
    depth[2, 3] = 2000
    cv2.imwrite(str(tmp_path / "0001-color.png"), colour)
    cv2.imwrite(str(tmp_path / "0001-depth.png"), depth)
    (tmp_path / "camera.yaml").write_text(INTRINSICS % IDENTITY)
    return tmp_path


def test_a_pair_becomes_a_frame_in_metres_with_unknown_depth_as_nan(folder):
    (frame,) = open_recording(folder)
    assert frame.depth[2, 3] == pytest.approx(1.0)
    assert np.isnan(frame.depth).sum() == 47
    assert frame.colour[0, 0].tolist() == [255, 0, 0], "red stays red"
    assert frame.intrinsics.cx == 3.5


def test_pairs_may_lie_in_folders_of_their_own(folder):
    for kind, word in (("rgb", "color"), ("depth", "depth")):
        (folder / kind).mkdir()
        (folder / f"0001-{word}.png").rename(folder / kind / "17.png")
    assert len(list(open_recording(folder))) == 1


def test_a_frame_may_have_a_pose_and_a_stamp_of_its_own(folder):
    moved = IDENTITY.replace("[1, 0, 0, 0]", "[1, 0, 0, 0.5]", 1)
    text = (INTRINSICS % IDENTITY)[:-1] + f", frames: {{0001-depth: {{stamp: 7.5, world_T_camera: {moved}}}}}}}"
    (folder / "camera.yaml").write_text(text)
    (frame,) = open_recording(folder)
    assert frame.stamp == 7.5 and frame.world_T_camera[0, 3] == 0.5


def test_a_json_intrinsics_file_elsewhere_can_be_named(folder, tmp_path_factory):
    file = tmp_path_factory.mktemp("other") / "lens.json"
    file.write_text(
        '{"xres": 8, "yres": 6, "fx": 10, "fy": 10, "cx": 3.5, "cy": 2.5, "depth_scale": 0.001, '
        f'"world_T_camera": {IDENTITY}}}'
    )
    (frame,) = open_recording(folder, intrinsics=file)
    assert frame.depth[2, 3] == pytest.approx(2.0)


def test_a_recording_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FrameError, match=r"there is no recording '.*gone'; give a folder of PNG pairs or"):
        open_recording(tmp_path / "gone")


def test_a_missing_colour_picture_is_named(folder):
    (folder / "0001-color.png").unlink()
    with pytest.raises(FrameError, match=r"0001-depth.png' needs one colour picture '0001-color\*\.png'.*found none"):
        open_recording(folder)


def test_a_missing_depth_picture_is_named(folder):
    (folder / "0001-depth.png").unlink()
    with pytest.raises(FrameError, match=r"0001-color.png' has no depth picture beside it"):
        open_recording(folder)


def test_an_empty_folder_says_how_to_name_pairs(tmp_path):
    (tmp_path / "camera.yaml").write_text(INTRINSICS % IDENTITY)
    with pytest.raises(FrameError, match="holds no pairs: name them"):
        open_recording(tmp_path)


def test_a_missing_intrinsics_file_says_what_belongs_inside(folder):
    (folder / "camera.yaml").unlink()
    with pytest.raises(FrameError, match=r"exactly one intrinsics file .*width, height, fx, fy.*found none"):
        open_recording(folder)


def test_an_unknown_key_of_the_intrinsics_file_is_named(folder):
    (folder / "camera.yaml").write_text((INTRINSICS % IDENTITY)[:-1] + ", focal: 3}")
    with pytest.raises(FrameError, match=r"focal: Extra inputs are not permitted; valid keys are \['camera', 'cx'"):
        open_recording(folder)


def test_depth_of_another_size_is_refused_with_both_sizes(folder):
    cv2.imwrite(str(folder / "0001-depth.png"), np.zeros((3, 4), np.uint16))
    with pytest.raises(FrameError, match="is 4x3; the intrinsics file says 8x6: register depth to colour"):
        list(open_recording(folder))


def test_an_eight_bit_depth_picture_is_refused(folder):
    cv2.imwrite(str(folder / "0001-depth.png"), np.zeros((6, 8), np.uint8))
    with pytest.raises(FrameError, match="it must be a 16-bit picture of one channel"):
        list(open_recording(folder))


def test_a_broken_picture_is_named(folder):
    (folder / "0001-color.png").write_bytes(b"not a picture")
    with pytest.raises(FrameError, match=r"0001-color.png' cannot be read as a picture"):
        list(open_recording(folder))


def more_pairs(folder, count):
    """Further pairs like the first."""
    for k in range(2, count + 1):
        for kind in ("color", "depth"):
            (folder / f"000{k}-{kind}.png").write_bytes((folder / f"0001-{kind}.png").read_bytes())


def test_a_broken_picture_in_the_middle_is_left_out_counted_and_named(folder):
    more_pairs(folder, 4)
    (folder / "0002-color.png").write_bytes(b"not a picture")
    whole = (folder / "0003-depth.png").read_bytes()
    (folder / "0003-depth.png").write_bytes(whole[:-20])
    recording = open_recording(folder)
    assert [f.stamp for f in recording] == [0.0, 3.0] and recording.count == 4
    assert [s.where for s in recording.skipped] == ["0002-depth.png", "0003-depth.png"]
    assert "0002-color.png' cannot be read as a picture" in recording.skipped[0].reason
    assert f"cut off after {len(whole) - 20} bytes" in recording.skipped[1].reason
    list(recording)
    assert len(recording.skipped) == 2, "a new iteration counts anew"


def test_a_folder_of_which_no_frame_can_be_used_says_why(folder):
    more_pairs(folder, 2)
    for k in (1, 2):
        (folder / f"000{k}-color.png").write_bytes(b"not a picture")
    with pytest.raises(FrameError, match=r"no frame of .* can be used \(2 left out\); first 0001-depth.png: the"):
        list(open_recording(folder))


def without_scale(folder, value):
    """The folder with an intrinsics file that does not say the unit, and depth of one value."""
    (folder / "camera.yaml").write_text((INTRINSICS % IDENTITY).replace("depth_scale: 0.0005, ", ""))
    cv2.imwrite(str(folder / "0001-depth.png"), np.full((6, 8), value, np.uint16))
    return folder


def test_a_unit_that_nobody_wrote_down_is_taken_as_millimetres_where_that_can_be(folder):
    recording = open_recording(without_scale(folder, 700))
    (frame,) = recording
    assert frame.depth[0, 0] == pytest.approx(0.7)
    assert recording.notes == ("nothing says the unit of the depth; taken as millimetres (half lie beyond 0.70 m)",)


@pytest.mark.parametrize(("value", "metres"), [(9000, "9"), (40, "0.04")])
def test_a_unit_that_nobody_wrote_down_is_asked_for_where_millimetres_are_absurd(folder, value, metres):
    with pytest.raises(FrameError, match=rf"half of the first would lie beyond {metres} m, .* say --depth-scale with"):
        open_recording(without_scale(folder, value))
    (frame,) = open_recording(folder, depth_scale=0.0001)
    assert frame.depth[0, 0] == pytest.approx(value / 10000)


def test_a_unit_that_is_said_goes_before_the_intrinsics_file(folder):
    (frame,) = open_recording(folder, depth_scale=0.001)
    assert frame.depth[2, 3] == pytest.approx(2.0)
    with pytest.raises(FrameError, match=r"a depth scale of 0 is not valid; it is metres per unit, for instance 0.001"):
        open_recording(folder, depth_scale=0.0)


def test_options_that_a_format_has_no_use_for_are_refused(folder, tmp_path):
    with pytest.raises(FrameError, match="has no use for --object-names: a folder of PNG pairs; leave it out"):
        open_recording(folder, object_names=folder / "names.yaml")
    save_npz(tmp_path / "dump.npz", [])
    with pytest.raises(FrameError, match="has no use for --depth-scale: a dump of frames says everything itself"):
        open_recording(tmp_path / "dump.npz", depth_scale=0.001)


def test_a_damaged_frame_in_the_middle_of_an_npz_is_left_out_and_named(tmp_path):
    rng, lens = np.random.default_rng(0), CameraIntrinsics(80, 60, 10.0, 11.0, 3.5, 2.5)
    pictures = [rng.integers(0, 255, (60, 80, 3), dtype=np.uint8) for _ in range(3)]
    depth = np.ones((60, 80), np.float32)
    save_npz(tmp_path / "dump.npz", [RgbdFrame(p, depth, lens, np.eye(4), float(i)) for i, p in enumerate(pictures)])
    data = bytearray((tmp_path / "dump.npz").read_bytes())
    at = data.index(b"1/colour.npy") + 2000  # in the middle of its pixels
    data[at : at + 50] = bytes(50)
    (tmp_path / "dump.npz").write_bytes(data)
    recording = open_recording(tmp_path / "dump.npz")
    assert [f.stamp for f in recording] == [0.0, 2.0]
    (skipped,) = recording.skipped
    assert skipped.where == "frame 1" and skipped.reason.startswith("it is damaged: ")


def test_frames_come_back_from_the_npz_as_they_were(tmp_path):
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.5, 1.5, (6, 8)).astype(np.float32)
    depth[0, 0] = np.nan
    lens = CameraIntrinsics(8, 6, 10.0, 11.0, 3.5, 2.5)
    frames = [
        RgbdFrame(rng.integers(0, 255, (6, 8, 3), dtype=np.uint8), depth, lens, np.eye(4), float(i), f"camera{i}")
        for i in range(2)
    ]
    save_npz(tmp_path / "dump.npz", frames)
    recording = open_recording(tmp_path / "dump.npz")
    assert recording.count == 2
    for before, after in zip(frames, recording, strict=True):
        assert np.array_equal(before.colour, after.colour)
        assert np.array_equal(before.depth, after.depth, equal_nan=True)
        assert (before.intrinsics, before.stamp, before.camera) == (after.intrinsics, after.stamp, after.camera)


def test_a_foreign_npz_is_refused(tmp_path):
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(FrameError, match="is not a dump of frames"):
        open_recording(tmp_path / "other.npz")


def test_a_damaged_npz_is_refused(tmp_path):
    (tmp_path / "broken.npz").write_bytes(b"PK\x03\x04 and then nothing")
    with pytest.raises(FrameError, match=r"cannot be read as an \.npz file"):
        open_recording(tmp_path / "broken.npz")


class BoxesByHand:
    """A detector for pictures in which somebody has drawn boxes."""

    name = "boxes by hand"

    def __init__(self, boxes: dict[str, tuple[float, float, float, float]]) -> None:
        self._boxes = boxes

    def detect(self, frame, phrases):
        return [Detection(p, np.array(self._boxes[p], float), 1.0) for p in phrases]


real = pytest.mark.skipif(not REAL_FRAMES.is_dir(), reason=f"no recorded real frames in {REAL_FRAMES}")


@real
def test_sizes_of_real_things_come_out_of_a_real_depth_camera(tmp_path):
    lens = tmp_path / "lens.yaml"
    lens.write_text(
        "{width: 640, height: 480, fx: 1066.778, fy: 1067.487, cx: 312.9869, cy: 241.3109, depth_scale: 0.0001}"
    )
    frames = list(open_recording(REAL_FRAMES / "posecnn_demo", intrinsics=lens))
    box = Perception(BoxesByHand({"yellow box": (203, 287, 335, 450)}), default_perception().segmenter)
    cans = Perception(BoxesByHand({"soup can": (178, 297, 280, 456)}), default_perception().segmenter)
    sugar = box.perceive(frames[:1], ["yellow_box"]).objects[0]
    soup = cans.perceive(frames[1:], ["soup_can"]).objects[0]
    # A sugar box is 93 x 176 x 45 mm; its white end looks like the table to colour, so its length is not judged.
    assert sorted(sugar.extents)[0] == pytest.approx(0.045, abs=0.017)
    assert sorted(sugar.extents)[1] == pytest.approx(0.093, abs=0.017)
    # A soup can is 68 mm wide.
    assert soup.extents[0] == pytest.approx(0.068, abs=0.012)


@real
def test_the_unit_of_real_pictures_in_tenths_of_millimetres_is_asked_for_and_of_those_in_millimetres_assumed(tmp_path):
    lens = tmp_path / "lens.yaml"
    lens.write_text("{width: 640, height: 480, fx: 1066.778, fy: 1067.487, cx: 312.9869, cy: 241.3109}")
    with pytest.raises(FrameError, match=r"would lie beyond 9.72 m, outside 0.15 to 5 m; say --depth-scale"):
        open_recording(REAL_FRAMES / "posecnn_demo", intrinsics=lens)
    assert len(list(open_recording(REAL_FRAMES / "posecnn_demo", intrinsics=lens, depth_scale=0.0001))) == 2
    assert "taken as millimetres (half lie beyond 0.6" in open_recording(REAL_FRAMES / "cleargrasp_d435").notes[0]


@real
def test_a_yellow_box_is_found_in_a_real_picture_by_its_colour(tmp_path):
    lens = tmp_path / "lens.yaml"
    lens.write_text(
        "{width: 640, height: 480, fx: 1066.778, fy: 1067.487, cx: 312.9869, cy: 241.3109, depth_scale: 0.0001}"
    )
    frame = next(iter(open_recording(REAL_FRAMES / "posecnn_demo", intrinsics=lens)))
    (found,) = default_perception().perceive([frame], ["yellow_box", "green_apple"]).objects
    assert found.name == "yellow_box"
    assert found.evidence[0].box_px == pytest.approx((203, 320, 335, 448), abs=12)


@real
def test_transparent_bottles_are_unseen_for_want_of_depth_and_painted_ones_are_seen():
    painted, clear = open_recording(REAL_FRAMES / "cleargrasp_d435")
    boxes = {"grey bottle": (617.0, 148.0, 721.0, 413.0)}
    looker = Perception(BoxesByHand(boxes), default_perception().segmenter)
    (seen,) = looker.perceive([painted], ["grey_bottle"]).objects
    assert seen.extents[2] == pytest.approx(0.15, abs=0.03)
    (unseen,) = looker.perceive([clear], ["grey_bottle"]).unseen
    assert unseen.reason.startswith("not enough depth (")
