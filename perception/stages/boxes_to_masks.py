"""Which pixels of a picture belong to which box: stacks are cut out together, and no pixel belongs to two things."""

from collections.abc import Mapping

import numpy as np

from perception.frames import RgbdFrame
from perception.geometry.stacks import own_pixels, whole_stack
from perception.interfaces import Detection, Segmenter


def masks_of(segmenter: Segmenter, frame: RgbdFrame, boxes: Mapping[str, Detection]) -> dict[str, np.ndarray]:
    """One mask a box by name, bool, shape (height, width); pixels that two of them claim go to the smaller one.

    Raises:
        ModelUnavailableError: As `Segmenter.segment_all` does.
    """
    masks = dict(zip(boxes, _cut_out(segmenter, frame, list(boxes.values())), strict=True))
    taken = np.zeros(frame.depth.shape, bool)
    # What stands on or in a thing hides it, not the reverse.
    for name in sorted(masks, key=lambda n: int(masks[n].sum())):
        masks[name] = masks[name] & ~taken
        taken |= masks[name]
    return masks


def _cut_out(segmenter: Segmenter, frame: RgbdFrame, boxes: list[Detection]) -> list[np.ndarray]:
    """One mask a box; things of one appearance that stand on each other are cut out together, then told apart."""
    wholes = [box if box.rest is None else whole_stack(box) for box in boxes]
    corners = np.array([box.box_px for box in wholes]).reshape(-1, 4)
    cut = segmenter.segment_all(frame, corners, [box.seed for box in wholes])
    return [
        mask if box.rest is None or box.seed is None else own_pixels(mask, box.seed, box.rest)
        for mask, box in zip(cut, boxes, strict=True)
    ]
