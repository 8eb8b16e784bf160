"""Masks from crops: a crop goes out and its mask comes back to the same pixels."""

import json

import cv2
import numpy as np
import pytest

from perception.detection.crop_segmenter import (
    CropSegmenter,
    CropSettings,
    box_in_crop,
    crop_picture,
    paste_mask,
    read_crop_settings,
    square_window,
)
from perception.detection.hf_segmenter import TransformersSegmenter
from perception.errors import ModelUnavailableError
from perception.pipeline import perception_from_options
from tests.support.models.perception_models import save_tiny_segmenter
from tests.support.scenes.perception_scenes import RED, cube, render

BOXES = np.array([[250.0, 180.0, 300.0, 240.0], [0.0, 0.0, 40.0, 30.0], [600.0, 440.0, 640.0, 480.0]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("crops") / "segmenter"
    save_tiny_segmenter(folder)
    (folder / "replan.json").write_text('{"crop_factor": 1.4}')
    return folder


@pytest.fixture(scope="module")
def frame():
    return render([cube(RED, 0.5, 0.0)])


def ellipse(box, shape):
    """Filled ellipse in a box, bool, of the shape of a picture."""
    x0, y0, x1, y1 = box
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    return ((x - (x0 + x1) / 2) / ((x1 - x0) / 2)) ** 2 + ((y - (y0 + y1) / 2) / ((y1 - y0) / 2)) ** 2 < 1


@pytest.mark.parametrize("box", [(100, 90, 160, 150), (-20, 30, 40, 70), (300, 100, 460, 220), (200, 200, 212, 208)])
def test_a_perfect_mask_of_a_crop_comes_back_to_its_place(box):
    truth = ellipse(box, (240, 320))
    picture = np.where(truth[..., None], 255, 0).astype(np.uint8).repeat(3, 2)
    window = square_window(np.array(box), 1.4)
    crop = crop_picture(picture, window, 128)
    # Logits at a quarter of the crop's size, as SAM gives them.
    logits = cv2.resize(crop[..., 0].astype(np.float32), (32, 32), interpolation=cv2.INTER_AREA) - 127.5
    mask = np.zeros(truth.shape, bool)
    paste_mask(logits, window, mask)
    assert (mask & truth).sum() / (mask | truth).sum() > 0.9


def test_a_box_lies_in_the_middle_of_its_crop():
    window = square_window(np.array([100.0, 100.0, 150.0, 140.0]), 1.4)
    assert window == (90, 85, 70)
    assert box_in_crop(np.array([100.0, 100.0, 150.0, 140.0]), window, 140) == pytest.approx([20, 30, 120, 110])


def test_what_lies_out_of_the_picture_has_the_mean_colour():
    crop = crop_picture(np.full((50, 60, 3), 200, np.uint8), (-10, 0, 20), 20)
    assert crop[0, 0].tolist() == [124, 116, 104] and crop[0, -1].tolist() == [200, 200, 200]
    assert crop_picture(np.zeros((50, 60, 3), np.uint8), (100, 100, 20), 20).min() == 104


def test_boxes_in_a_batch_give_what_each_gives_alone(folder, frame):
    segmenter = CropSegmenter(folder, CropSettings(crop_factor=1.4))
    together = segmenter.segment_all(frame, BOXES)
    assert together.shape == (3, 480, 640) and together.any()
    for mask, box in zip(together, BOXES, strict=True):
        assert np.mean(mask != segmenter.segment(frame, box)) < 0.0001
        left, top, side = square_window(box, 1.4)
        outside = np.ones_like(mask)
        outside[max(top, 0) : top + side, max(left, 0) : left + side] = False
        assert not (mask & outside).any(), "nothing out of the crop"
    assert segmenter.segment_all(frame, np.zeros((0, 4))).shape == (0, 480, 640)


def test_pixels_of_the_support_can_be_left_out(folder, frame):
    box = np.array([200.0, 150.0, 400.0, 350.0])
    plain, trimmed = (
        CropSegmenter(folder, CropSettings(crop_factor=1.4, drop_support=drop)).segment(frame, box)
        for drop in (False, True)
    )
    assert not (trimmed & ~plain).any() and trimmed.sum() < plain.sum()


def test_a_file_beside_the_weights_chooses_crops(folder, tmp_path):
    assert isinstance(perception_from_options("colour", str(folder)).segmenter, CropSegmenter)
    save_tiny_segmenter(tmp_path)
    assert isinstance(perception_from_options("colour", str(tmp_path)).segmenter, TransformersSegmenter)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("{", "text: "),
        (json.dumps({"crop_factor": 0.5}), "crop_factor: Input should be greater than 1"),
        (json.dumps({"crop_factor": 1.4, "padding": 3}), "padding: Extra inputs are not permitted"),
    ],
)
def test_settings_that_are_not_valid_are_named(tmp_path, text, fault):
    (tmp_path / "replan.json").write_text(text)
    with pytest.raises(ModelUnavailableError) as caught:
        read_crop_settings(tmp_path)
    assert f"replan.json is not valid ({fault}" in str(caught.value)
    assert 'it must be like {"crop_factor": 1.4, "drop_support": true}' in str(caught.value)
