"""Learned detectors and segmenters through `transformers`: the GroundingDINO family, SAM and SAM 2.

Weights come from a local folder or, by name, from what the hub's client has downloaded to this machine or may download.
They are loaded at first use and once per process. Nothing heavy is imported before that.
"""

import functools
import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from perception.errors import ModelUnavailableError
from perception.frames import RgbdFrame
from perception.interfaces import Detection

# Means and spreads of ImageNet's RGB channels, 0..1; the published SAM 2 weights were trained with them.
IMAGENET_MEAN = np.array([0.485, 0.456, 0.406])
IMAGENET_STD = np.array([0.229, 0.224, 0.225])


class TransformersDetector:
    """Zero-shot detection with a model of the GroundingDINO family.

    Every phrase is scored by its own tokens: the mean over them of the probability that a box matches the token, so
    that "red cube" needs both words, and labels of different phrases cannot merge.
    """

    def __init__(
        self,
        model: str,
        offline: bool = False,
        threshold: float = 0.25,
        most_boxes: int = 20,
        short_side: int | None = None,
    ) -> None:
        """Remember the choice; weights are loaded by the first `detect`.

        Args:
            model: A folder, or a hub name such as "IDEA-Research/grounding-dino-tiny".
            offline: Never ask the hub.
            threshold: Lowest score of a box, 0..1.
            most_boxes: At most so many boxes per phrase.
            short_side: Picture's shorter side for the model in [px]; the model's own default if None.
        """
        self.model = model
        self.offline = offline
        self.threshold = threshold
        self.most_boxes = most_boxes
        self.short_side = short_side

    @property
    def name(self) -> str:
        """Says which weights answered."""
        return f"{self.model} (learned detector, transformers)"

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """All boxes above the threshold, best first.

        Raises:
            ModelUnavailableError: The weights or packages are not on this machine, or are of another kind.
        """
        if not phrases:
            return []
        torch = load_package("torch")
        processor, model = _load_detector(self.model, self.offline)
        found: list[Detection] = []
        limit = int(getattr(model.config, "max_text_len", 256))
        for text, spans in prompts(processor.tokenizer, phrases, limit):
            size = {}
            if self.short_side:
                size["size"] = {"shortest_edge": self.short_side, "longest_edge": 2 * self.short_side}
            inputs = processor(images=np.array(frame.colour), text=text, return_tensors="pt", **size).to(model.device)
            with torch.inference_mode():
                output = model(**inputs)
            match = output.logits[0].float().sigmoid().cpu().numpy()
            boxes = _corner_boxes(output.pred_boxes[0].float().cpu().numpy(), frame)
            for phrase, (first, after) in spans.items():
                scores = match[:, first:after].mean(1)
                for i in np.argsort(-scores)[: self.most_boxes]:
                    if scores[i] >= self.threshold and np.all(boxes[i, 2:] - boxes[i, :2] >= 2.0):
                        found.append(Detection(phrase, boxes[i], float(scores[i])))
        return sorted(found, key=lambda d: -d.score)


class TransformersSegmenter:
    """Masks from boxes with SAM or SAM 2; the picture is embedded once for all of its boxes."""

    def __init__(self, model: str, offline: bool = False) -> None:
        """Remember the choice; weights are loaded by the first `segment`.

        Args:
            model: A folder, or a hub name such as "facebook/sam-vit-base" or "facebook/sam2-hiera-tiny".
            offline: Never ask the hub.
        """
        self.model = model
        self.offline = offline
        self._embedded: tuple[np.ndarray, Any] | None = None

    @property
    def name(self) -> str:
        """Says which weights answered."""
        return f"{self.model} (learned segmenter, transformers)"

    def segment(self, frame: RgbdFrame, box_px: np.ndarray, seed: np.ndarray | None = None) -> np.ndarray:
        """Pixels of the object in a box, bool, shape (height, width); `seed` is not needed.

        Raises:
            ModelUnavailableError: The weights or packages are not on this machine, or are of another kind.
        """
        torch = load_package("torch")
        processor, model = _load_segmenter(self.model, self.offline)
        if processor is None:
            return self._segment_sam2(frame, box_px, torch, model)
        box = [[[float(b) for b in box_px]]]
        inputs = processor(images=np.array(frame.colour), input_boxes=box, return_tensors="pt").to(model.device)
        with torch.inference_mode():
            if self._embedded is None or self._embedded[0] is not frame.colour:
                self._embedded = (frame.colour, model.get_image_embeddings(inputs["pixel_values"]))
            output = model(
                input_boxes=inputs["input_boxes"], image_embeddings=self._embedded[1], multimask_output=False
            )
        sizes = inputs["original_sizes"].cpu(), inputs["reshaped_input_sizes"].cpu()
        masks = processor.post_process_masks(output.pred_masks.float().cpu(), *sizes)
        return np.asarray(masks[0]).reshape(-1, *frame.depth.shape)[0] > 0

    def _segment_sam2(self, frame: RgbdFrame, box_px: np.ndarray, torch: Any, model: Any) -> np.ndarray:
        """The same with SAM 2, whose processor in `transformers` needs a further package for a plain resize.

        SAM 2 sees the picture stretched to a square and normalised as for ImageNet; boxes are stretched alike.
        """
        size = model.config.prompt_encoder_config.image_size
        side = int(size[0] if isinstance(size, list | tuple) else size)
        height, width = frame.depth.shape
        if self._embedded is None or self._embedded[0] is not frame.colour:
            square = cv2.resize(np.array(frame.colour), (side, side), interpolation=cv2.INTER_LINEAR)
            normal = (square / 255.0 - IMAGENET_MEAN) / IMAGENET_STD
            pixels = torch.tensor(normal.transpose(2, 0, 1)[None], dtype=torch.float32, device=model.device)
            with torch.inference_mode():
                self._embedded = (frame.colour, model.get_image_embeddings(pixels))
        box = np.asarray(box_px, float) * side / np.array([width, height, width, height])
        boxes = torch.tensor(box.reshape(1, 1, 4), dtype=torch.float32, device=model.device)
        with torch.inference_mode():
            output = model(input_boxes=boxes, image_embeddings=self._embedded[1], multimask_output=False)
        logits = output.pred_masks.float().cpu().numpy()
        logits = np.ascontiguousarray(logits.reshape(-1, *logits.shape[-2:])[0])
        return cv2.resize(logits, (width, height), interpolation=cv2.INTER_LINEAR) > 0


def prompts(tokenizer: Any, phrases: Sequence[str], limit: int) -> list[tuple[str, dict[str, tuple[int, int]]]]:
    """Join phrases to prompts "red cube. crate." of at most `limit` tokens, and say which tokens are whose.

    Args:
        tokenizer: Of the model.
        phrases: Any number.
        limit: Longest prompt in tokens, its two end marks included.

    Returns:
        Prompts, each with (first, one after the last) token of each of its phrases.
    """
    stop = len(tokenizer(".", add_special_tokens=False)["input_ids"])
    joined: list[tuple[str, dict[str, tuple[int, int]]]] = []
    text, spans, position = "", {}, 1  # token 0 marks the beginning
    for phrase in dict.fromkeys(phrases):
        plain = phrase.strip().lower().rstrip(".")
        length = len(tokenizer(plain, add_special_tokens=False)["input_ids"])
        if spans and position + length + stop + 1 > limit:
            joined.append((text, spans))
            text, spans, position = "", {}, 1
        spans[phrase] = (position, min(position + length, limit - 1))
        text = f"{text} {plain}.".strip()
        position += length + stop
    joined.append((text, spans))
    return joined


def _corner_boxes(boxes: np.ndarray, frame: RgbdFrame) -> np.ndarray:
    """Boxes (centre x, centre y, width, height) in shares of the picture as corners in [px], shape (n, 4)."""
    width, height = frame.intrinsics.width, frame.intrinsics.height
    centre, half = boxes[:, :2], boxes[:, 2:] / 2
    corners = np.concatenate([centre - half, centre + half], 1) * [width, height, width, height]
    return np.clip(corners, 0.0, [width, height, width, height])


@functools.lru_cache(maxsize=4)
def _load_detector(model: str, offline: bool) -> tuple[Any, Any]:
    transformers = load_package("transformers")

    def load(local: bool) -> tuple[Any, Any]:
        processor = transformers.AutoProcessor.from_pretrained(model, local_files_only=local)
        network = transformers.AutoModelForZeroShotObjectDetection.from_pretrained(model, local_files_only=local)
        return processor, network

    return _ready(model, "zero-shot detector (GroundingDINO family)", load, offline)


@functools.lru_cache(maxsize=4)
def _load_segmenter(model: str, offline: bool) -> tuple[Any, Any]:
    transformers = load_package("transformers")

    def load(local: bool) -> tuple[Any, Any]:
        kind = transformers.AutoConfig.from_pretrained(model, local_files_only=local).model_type
        if kind.startswith("sam2"):
            return None, transformers.Sam2Model.from_pretrained(model, local_files_only=local)
        if kind != "sam":
            raise ValueError(f"model type '{kind}'")
        processor = transformers.SamProcessor.from_pretrained(model, local_files_only=local)
        return processor, transformers.SamModel.from_pretrained(model, local_files_only=local)

    return _ready(model, "SAM or SAM 2", load, offline)


def _ready(model: str, kind: str, load: Callable[[bool], tuple[Any, Any]], offline: bool) -> tuple[Any, Any]:
    """Load processor and network, in single precision, for use only.

    Raises:
        ModelUnavailableError: With the command that fetches the weights, or what is wrong with them.
    """
    torch = load_package("torch")
    is_folder = Path(model).expanduser().is_dir()
    if not is_folder and (model.startswith((".", "/", "~")) or model.count("/") != 1):
        raise ModelUnavailableError(
            f"there is no folder '{model}' and it is no hub name (owner/model); "
            "give a folder that holds config.json and weights, or a name such as IDEA-Research/grounding-dino-tiny"
        )
    try:
        processor, network = load(offline or is_folder)
    except ImportError as error:
        reason = str(error).strip().splitlines()[0]
        raise ModelUnavailableError(f"'{model}' needs a package that is not installed: {reason}") from error
    except (OSError, ValueError, KeyError) as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        if is_folder:
            raise ModelUnavailableError(
                f"the folder '{model}' does not hold a {kind} that transformers can load: {reason}"
            ) from error
        raise ModelUnavailableError(
            f"the weights of '{model}' ({kind}) are not on this machine; "
            f"fetch them once with: .venv/bin/hf download {model}"
        ) from error
    device = "cuda" if torch.cuda.is_available() else "cpu"
    return processor, network.to(device=device, dtype=torch.float32).eval()


def load_package(name: str) -> Any:
    """Import torch or transformers, without triton.

    Triton carries an LLVM of its own that crashes the process when OpenGL in software (Mesa, which carries another) was
    loaded before it, as it is where MuJoCo renders without a GPU. Running a model eagerly does not need triton.

    Raises:
        ModelUnavailableError: The package is not installed.
    """
    sys.modules.setdefault("triton", None)  # type: ignore[arg-type]
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ModelUnavailableError(
            f"learned detectors and segmenters need the package '{name}', which is not installed; install it with: "
            "make setup"
        ) from error
