"""Masks from boxes with a SAM that looks at a crop around each box, not at the whole picture.

A small network sees a small thing at full detail this way. What it was trained with stands in a `replan.json` beside
its weights, for instance {"crop_factor": 1.4, "drop_support": true}.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from perception.detection.devices import Precision, arithmetic, choose_device, load_package
from perception.detection.grabcut import GrabCutSettings
from perception.detection.hf_segmenter import BOXES_AT_ONCE, IMAGENET_MEAN, IMAGENET_STD, load_segmenter
from perception.detection.model_files import SEGMENTER, find_model
from perception.detection.support_pixels import surely_support
from perception.errors import ModelUnavailableError
from perception.frames import RgbdFrame
from perception.geometry.prepared_frame import PreparedFrame

SETTINGS_FILE = "replan.json"


class CropSettings(BaseModel):
    """Contents of a replan.json.

    Attributes:
        crop_factor: Side of the square crop, as a multiple of the box's longer side.
        drop_support: Whether pixels that depth shows to be the support are taken out of the masks.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    crop_factor: float = Field(gt=1.0, le=10.0)
    drop_support: bool = False


def read_crop_settings(folder: Path) -> CropSettings | None:
    """Settings of the weights in a folder; None if they are for whole pictures.

    Raises:
        ModelUnavailableError: The file is there and not valid.
    """
    path = folder / SETTINGS_FILE
    if not path.is_file():
        return None
    try:
        return CropSettings.model_validate(json.loads(path.read_text()))
    except (ValueError, ValidationError) as error:
        reason = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
        where = ".".join(str(k) for k in error.errors()[0]["loc"]) if isinstance(error, ValidationError) else "text"
        raise ModelUnavailableError(
            f'{path} is not valid ({where}: {reason}); it must be like {{"crop_factor": 1.4, "drop_support": true}}'
        ) from error


class CropSegmenter:
    """SAM on crops, all boxes of a picture as one batch."""

    def __init__(
        self,
        folder: Path,
        settings: CropSettings,
        device: str = "auto",
        precision: Precision = "auto",
        name: str | None = None,
    ) -> None:
        """Remember the choice; weights are loaded by the first `segment`.

        Args:
            folder: Of a SAM whose input is as large as its crops.
            settings: What it was trained with.
            device: As in `perception.detection.devices.choose_device`.
            precision: As in `perception.detection.devices.arithmetic`.
            name: For people to read.
        """
        self.folder = folder
        self.settings = settings
        self.device = device
        self.precision: Precision = precision
        self.name = name or f"{folder} (learned segmenter on crops, transformers)"

    def segment(self, frame: RgbdFrame, box_px: np.ndarray, seed: np.ndarray | None = None) -> np.ndarray:
        """Pixels of the object in a box, bool, shape (height, width); `seed` is not needed.

        Raises:
            ModelUnavailableError: The weights, packages or device are not on this machine, or are of another kind.
        """
        return self.segment_all(frame, np.reshape(box_px, (1, 4)))[0]

    def segment_all(
        self, frame: RgbdFrame, boxes_px: np.ndarray, seeds: Sequence[np.ndarray | None] = ()
    ) -> np.ndarray:
        """Pixels of the objects in several boxes, bool, shape (n, height, width); seeds are not needed.

        Args:
            frame: Picture to cut from.
            boxes_px: (x0, y0, x1, y1) in [px], shape (n, 4).
            seeds: Not used.

        Raises:
            ModelUnavailableError: The weights, packages or device are not on this machine, or are of another kind.
        """
        masks = np.zeros((len(boxes_px), *frame.depth.shape), bool)
        if not len(boxes_px):
            return masks
        torch = load_package("torch")
        device = choose_device(self.device)
        _, network = load_segmenter(find_model(str(self.folder), SEGMENTER, offline=True), device)
        side = int(network.config.vision_config.image_size)
        windows = [square_window(box, self.settings.crop_factor) for box in boxes_px]
        crops = np.array([crop_picture(frame.colour, window, side) for window in windows])
        prompts = np.array([box_in_crop(b, w, side) for b, w in zip(boxes_px, windows, strict=True)])
        pixels = torch.tensor((crops / 255.0 - IMAGENET_MEAN) / IMAGENET_STD, dtype=torch.float32).permute(0, 3, 1, 2)
        boxes = torch.tensor(prompts[:, None], dtype=torch.float32)
        with torch.inference_mode(), arithmetic(device, self.precision):
            for start in range(0, len(masks), BOXES_AT_ONCE):
                part = slice(start, start + BOXES_AT_ONCE)
                output = network(
                    pixel_values=pixels[part].to(device), input_boxes=boxes[part].to(device), multimask_output=False
                )
                logits = output.pred_masks[:, 0, 0].float().cpu().numpy()
                for mask, window, one in zip(masks[part], windows[part], logits, strict=True):
                    paste_mask(one, window, mask)
        if self.settings.drop_support:
            limits = GrabCutSettings()
            masks &= ~surely_support(PreparedFrame.of(frame), limits.clearance, limits.foot_px)
        return masks


Window = tuple[int, int, int]
"""Left and upper edge and side of a square of whole pixels, in [px]; it may reach out of the picture."""


def square_window(box_px: np.ndarray, factor: float) -> Window:
    """The square of whole pixels around a box whose side is `factor` times the box's longer side.

    Args:
        box_px: (x0, y0, x1, y1) in [px], shape (4,).
        factor: Above 1.
    """
    x0, y0, x1, y1 = (float(v) for v in box_px)
    side = max(8, round(factor * max(x1 - x0, y1 - y0)))
    return round((x0 + x1 - side) / 2), round((y0 + y1 - side) / 2), side


def crop_picture(colour: np.ndarray, window: Window, side: int) -> np.ndarray:
    """A window of a picture, resized.

    Args:
        colour: RGB, uint8, shape (height, width, 3).
        window: From `square_window`; what lies out of the picture is filled with ImageNet's mean colour.
        side: Of the result in [px].

    Returns:
        RGB, uint8, shape (side, side, 3). Shrinking averages, so that detail does not alias.
    """
    left, top, size = window
    height, width = colour.shape[:2]
    crop = np.empty((size, size, 3), np.uint8)
    crop[:] = np.round(255 * IMAGENET_MEAN).astype(np.uint8)
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + size, width), min(top + size, height)
    if x1 > x0 and y1 > y0:
        crop[y0 - top : y1 - top, x0 - left : x1 - left] = colour[y0:y1, x0:x1]
    return cv2.resize(crop, (side, side), interpolation=cv2.INTER_AREA if size > side else cv2.INTER_LINEAR)


def box_in_crop(box_px: np.ndarray, window: Window, side: int) -> np.ndarray:
    """A box of the picture in pixels of the resized crop, (x0, y0, x1, y1), shape (4,)."""
    left, top, size = window
    return (np.asarray(box_px, float) - [left, top, left, top]) * side / size


def paste_mask(logits: np.ndarray, window: Window, mask: np.ndarray) -> None:
    """Write a crop's mask into a picture's: logits are interpolated linearly, above 0 is the object.

    Args:
        logits: Of the window, shape (n, n).
        window: Where it lies.
        mask: Written to, bool, shape (height, width).
    """
    left, top, size = window
    inside = cv2.resize(np.ascontiguousarray(logits), (size, size), interpolation=cv2.INTER_LINEAR) > 0
    height, width = mask.shape
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + size, width), min(top + size, height)
    if x1 > x0 and y1 > y0:
        mask[y0:y1, x0:x1] = inside[y0 - top : y1 - top, x0 - left : x1 - left]
