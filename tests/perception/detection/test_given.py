"""Boxes and masks that a person drew, and several things of one name."""

import cv2
import numpy as np
import pytest

from perception.detection.given import BoxesByFrame, GivenBoxes, MasksByFrame
from perception.errors import FrameError
from perception.pipeline import Perception, default_perception
from perception.recordings.frame_keys import frame_keys, key_of_depth_file
from perception.recordings.opening import open_recording, save_npz
from perception.tracking.instances import instance_name
from tests.support.scenes.perception_scenes import RED, YELLOW, cube, render

KEYS = ("000002", "000003")


def box_file(tmp_path, text: str):
    path = tmp_path / "boxes.yaml"
    path.write_text(text)
    return path


def test_boxes_of_one_frame_take_the_place_of_those_for_all(tmp_path):
    path = box_file(
        tmp_path, 'boxes: {crate: [1, 2, 30, 40]}\nframes: {"000003": {crate: [5, 6, 30, 40], can: [0, 0, 9, 9]}}'
    )
    given = BoxesByFrame(path, KEYS)
    assert given.names == ("crate", "can")
    assert given.of("000002").boxes["crate"].tolist() == [[1, 2, 30, 40]]
    assert {n: b.tolist() for n, b in given.of("000003").boxes.items()} == {
        "crate": [[5, 6, 30, 40]],
        "can": [[0, 0, 9, 9]],
    }


def test_boxes_given_by_hand_say_so_and_end_at_the_border():
    frame = render([cube(RED, 0.5, 0.0)])
    (found,) = GivenBoxes({"red_cube": np.array([[-20.0, 10.0, 50.0, 999.0]])}).detect(frame, ["red cube", "crate"])
    assert (found.phrase, found.score, found.box_px.tolist()) == ("red cube", 1.0, [0, 10, 50, 480])
    assert GivenBoxes({}).name == "boxes given by hand"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            'frames: {"000009": {can: [0, 0, 9, 9]}}',
            "names the frame '000009', which the recording does not have; its frames are 000002, 000003",
        ),
        ("boxes: {can: [9, 0, 0, 9]}", "the box of 'can' in boxes needs x0 < x1 and y0 < y1"),
        ("boxes: {can: [0, 0, 9]}", "not valid at boxes.can"),
        ("boxes: {7up: [0, 0, 9, 9]}", "not valid at boxes.7up"),
        ("box: {can: [0, 0, 9, 9]}", "not valid at box: Extra inputs are not permitted"),
        ("frames: {7: {can: [0, 0, 9, 9]}}", "keys in quotes"),
        ("boxes: [", "cannot be read"),
    ],
)
def test_mistakes_in_a_file_of_boxes_are_told_by_place(tmp_path, text, reason):
    with pytest.raises(FrameError) as caught:
        BoxesByFrame(box_file(tmp_path, text), KEYS)
    assert reason in str(caught.value)


def test_masks_are_found_by_frame_and_name_and_labels_by_number(tmp_path):
    whole, part, labels = np.zeros((8, 10), np.uint8), np.zeros((8, 10), np.uint8), np.zeros((8, 10), np.uint8)
    whole[2:6, 2:6], part[2:4, 2:6], labels[:, 8:] = 255, 1, 2
    cv2.imwrite(str(tmp_path / "sugar_box.png"), whole)
    cv2.imwrite(str(tmp_path / "000003_sugar_box.png"), part)
    cv2.imwrite(str(tmp_path / "000003_labels.png"), labels)
    (tmp_path / "labels.yaml").write_text("{1: apple, 2: can}")
    given = MasksByFrame(tmp_path, KEYS)
    assert given.names == ("sugar_box", "apple", "can")
    assert {n: int(m.sum()) for n, m in given.of("000002").masks.items()} == {"sugar_box": 16}
    assert {n: int(m.sum()) for n, m in given.of("000003").masks.items()} == {"sugar_box": 8, "can": 16}


@pytest.mark.parametrize(
    ("file", "reason"),
    [
        ("000009_can.png", "names the frame '000009', which the recording does not have; its frames are 000002"),
        ("000002_Can.png", "is named for nothing: name it <name>.png or <frame>_<name>.png"),
        ("labels.png", "must say what the numbers of the label pictures mean"),
    ],
)
def test_masks_that_are_named_for_nothing_are_refused(tmp_path, file, reason):
    cv2.imwrite(str(tmp_path / file), np.ones((8, 10), np.uint8))
    with pytest.raises(FrameError) as caught:
        MasksByFrame(tmp_path, KEYS)
    assert reason in str(caught.value)


def test_a_number_without_a_meaning_and_a_mask_of_another_size_are_named(tmp_path):
    cv2.imwrite(str(tmp_path / "labels.png"), np.full((8, 10), 3, np.uint8))
    (tmp_path / "labels.yaml").write_text("{1: apple}")
    with pytest.raises(FrameError, match=r"holds the numbers \[3\], which labels.yaml does not explain; it has \[1\]"):
        MasksByFrame(tmp_path, KEYS).of("000002")
    (tmp_path / "labels.png").unlink()
    cv2.imwrite(str(tmp_path / "red_cube.png"), np.ones((8, 10), np.uint8))
    masks = MasksByFrame(tmp_path, KEYS).of("000002")
    with pytest.raises(FrameError, match="the mask of 'red cube' is 10x8; the frame is 640x480"):
        Perception(masks, masks).perceive([render([cube(RED, 0.5, 0.0)])], ["red_cube"])


def test_a_mask_given_by_hand_leads_to_a_pose_without_any_detector(tmp_path):
    frame = render([cube(RED, 0.5, 0.1)])
    hue = frame.colour.astype(int)
    cv2.imwrite(str(tmp_path / "toy.png"), 255 * ((hue[..., 0] - hue[..., 1]) > 60).astype(np.uint8))
    masks = MasksByFrame(tmp_path, None).of("0")
    scene = Perception(masks, masks).perceive([frame], ["toy"])
    assert scene.objects[0].position == pytest.approx((0.5, 0.1, 0.03), abs=0.006)
    assert scene.source == "masks given by hand + masks given by hand"


def test_frames_of_a_folder_are_keyed_by_file_and_others_by_number(tmp_path):
    folder = tmp_path / "pairs"
    folder.mkdir()
    for name in ("a1", "b2"):
        cv2.imwrite(str(folder / f"{name}-color.png"), np.zeros((48, 64, 3), np.uint8))
        cv2.imwrite(str(folder / f"{name}-depth-mm.png"), np.full((48, 64), 500, np.uint16))
    (folder / "camera.yaml").write_text("{width: 64, height: 48, fx: 60, fy: 60, cx: 31.5, cy: 23.5}")
    assert frame_keys(folder, open_recording(folder, depth_scale=0.001)) == ("a1", "b2")
    save_npz(tmp_path / "two.npz", [render([], size=(64, 48))] * 2)
    assert frame_keys(tmp_path / "two.npz", open_recording(tmp_path / "two.npz")) == ("0", "1")


def test_a_key_is_what_stands_before_the_word_depth(tmp_path):
    files = ("000002-depth.png", "depth_0007.png", "0007.png", "x_opaque-Depth-mm.png")
    assert [key_of_depth_file(tmp_path / f) for f in files] == ["000002", "0007", "0007", "x_opaque"]


def test_several_things_of_one_name_are_found_when_they_are_asked_for():
    frame = render([cube(RED, 0.45, -0.12), cube(RED, 0.5, 0.12), cube(YELLOW, 0.6, 0.0)])
    embedded = default_perception()
    one = embedded.perceive([frame], ["red_cube", "yellow_cube"])
    assert one.names == ("red_cube", "yellow_cube")
    two = Perception(embedded.detector, embedded.segmenter, instances=3).perceive([frame], ["red_cube", "yellow_cube"])
    assert two.names == ("red_cube", "red_cube_2", "yellow_cube")
    assert sorted(round(float(o.position[1]), 2) for o in two.objects[:2]) == [-0.12, 0.12]
    assert [o.phrase for o in two.objects[:2]] == ["red cube", "red cube"]


def test_two_cameras_agree_on_which_of_two_is_which():
    things = [cube(RED, 0.45, -0.12), cube(RED, 0.5, 0.12)]
    left = render(things, eye=(1.0, -0.4, 0.6), camera="left")
    right = render(things, eye=(1.0, 0.4, 0.6), camera="right", seed=1)
    embedded = default_perception()
    scene = Perception(embedded.detector, embedded.segmenter, instances=2).perceive([left, right], ["red_cube"])
    assert scene.names == ("red_cube", "red_cube_2")
    assert [len(o.evidence) for o in scene.objects] == [2, 2]


def test_a_further_name_leaves_names_alone_that_are_taken():
    assert instance_name("cup", {"cup", "cup_2"}) == "cup_3"
    assert instance_name("cup", ()) == "cup"


def test_a_name_in_a_file_of_boxes_may_be_written_as_people_say_it(tmp_path):
    given = BoxesByFrame(box_file(tmp_path, "boxes: {Sugar box: [0, 0, 9, 9]}"), KEYS).of("000002")
    assert list(given.boxes) == ["sugar_box"]
