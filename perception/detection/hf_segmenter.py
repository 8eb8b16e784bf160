"""Learned segmenters through `transformers`: SAM and SAM 2.

Weights are loaded at first use and once per process and device. Nothing heavy is imported before that.
"""

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from perception.detection.devices import Precision, arithmetic, choose_device, load_package
from perception.detection.hf_loading import complete_network, loaded
from perception.detection.model_files import SEGMENTER, find_model
from perception.frames import RgbdFrame

# Means and spreads of ImageNet's RGB channels, 0..1; the published SAM 2 weights were trained with them.
IMAGENET_MEAN = np.array([0.485, 0.456, 0.406])
IMAGENET_STD = np.array([0.229, 0.224, 0.225])
BOXES_AT_ONCE = 32  # of one picture, so that memory does not grow with what is asked for


class TransformersSegmenter:
    """Masks from boxes with SAM or SAM 2; the picture is embedded once for all of its boxes."""

    def __init__(self, model: str, offline: bool = False, device: str = "auto", precision: Precision = "auto") -> None:
        """Remember the choice; weights are loaded by the first `segment`.

        Args:
            model: A folder, or a hub name such as "facebook/sam-vit-base" or "facebook/sam2-hiera-tiny".
            offline: Never ask the hub.
            device: As in `perception.detection.devices.choose_device`.
            precision: As in `perception.detection.devices.arithmetic`.
        """
        self.model = model
        self.offline = offline
        self.device = device
        self.precision: Precision = precision
        self._embedded: tuple[np.ndarray, Any] | None = None

    @property
    def name(self) -> str:
        """Says which weights answered."""
        return f"{self.model} (learned segmenter, transformers)"

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
        processor, network = load_segmenter(find_model(self.model, SEGMENTER, self.offline), device)
        view = _Stretched(frame, network) if processor is None else _Padded(frame, processor)
        with torch.inference_mode(), arithmetic(device, self.precision):
            if self._embedded is None or self._embedded[0] is not frame.colour:
                self._embedded = (frame.colour, network.get_image_embeddings(view.pixels(torch).to(device)))
            for start in range(0, len(masks), BOXES_AT_ONCE):
                boxes = torch.tensor(view.boxes(boxes_px[start : start + BOXES_AT_ONCE])[None], dtype=torch.float32)
                output = network(
                    input_boxes=boxes.to(device), image_embeddings=self._embedded[1], multimask_output=False
                )
                logits = output.pred_masks.float().cpu()
                masks[start : start + BOXES_AT_ONCE] = view.masks(logits)
        return masks


class _Padded:
    """How SAM sees a picture: its longer side resized, the rest of the square empty. The processor does it."""

    def __init__(self, frame: RgbdFrame, processor: Any) -> None:
        self._processor = processor
        self._seen = processor.image_processor(np.array(frame.colour), return_tensors="pt")
        width, height = frame.intrinsics.width, frame.intrinsics.height
        seen_height, seen_width = (int(n) for n in self._seen["reshaped_input_sizes"][0])
        self._scale = np.array([seen_width / width, seen_height / height] * 2)

    def pixels(self, torch: Any) -> Any:
        return self._seen["pixel_values"]

    def boxes(self, boxes_px: np.ndarray) -> np.ndarray:
        return np.asarray(boxes_px, float) * self._scale

    def masks(self, logits: Any) -> np.ndarray:
        sizes = self._seen["original_sizes"], self._seen["reshaped_input_sizes"]
        return np.asarray(self._processor.post_process_masks(logits, *sizes)[0])[:, 0] > 0


class _Stretched:
    """How SAM 2 sees a picture: stretched to a square and normalised as for ImageNet, boxes stretched alike.

    Its processor in `transformers` needs a further package (torchvision) for this plain resize.
    """

    def __init__(self, frame: RgbdFrame, network: Any) -> None:
        size = network.config.prompt_encoder_config.image_size
        self._side = int(size[0] if isinstance(size, list | tuple) else size)
        self._frame = frame

    def pixels(self, torch: Any) -> Any:
        square = cv2.resize(np.array(self._frame.colour), (self._side, self._side), interpolation=cv2.INTER_LINEAR)
        normal = (square / 255.0 - IMAGENET_MEAN) / IMAGENET_STD
        return torch.tensor(normal.transpose(2, 0, 1)[None], dtype=torch.float32)

    def boxes(self, boxes_px: np.ndarray) -> np.ndarray:
        width, height = self._frame.intrinsics.width, self._frame.intrinsics.height
        return np.asarray(boxes_px, float) * self._side / np.array([width, height, width, height])

    def masks(self, logits: Any) -> np.ndarray:
        height, width = self._frame.depth.shape
        flat = np.asarray(logits).reshape(-1, *logits.shape[-2:])
        return np.array([cv2.resize(one, (width, height), interpolation=cv2.INTER_LINEAR) > 0 for one in flat])


@functools.lru_cache(maxsize=4)
def load_segmenter(folder: Path, device: str) -> tuple[Any, Any]:
    """Processor (None for SAM 2) and network of a folder that `find_model` found; once per process and device.

    Raises:
        ModelUnavailableError: The files cannot be loaded.
    """
    transformers = load_package("transformers")

    def load() -> tuple[Any, Any]:
        network = complete_network(transformers.AutoModelForMaskGeneration, folder)
        if network.config.model_type != "sam":
            return None, network
        return transformers.AutoProcessor.from_pretrained(folder, local_files_only=True), network

    return loaded(folder, SEGMENTER, load, device)
