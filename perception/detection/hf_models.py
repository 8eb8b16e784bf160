"""Learned detectors and segmenters through `transformers`: the GroundingDINO family, SAM and SAM 2.

Weights come from a local folder or, by name, from what the hub's client has downloaded to this machine or may download.
They are loaded at first use and once per process and device. Nothing heavy is imported before that.
"""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from perception.detection.devices import Precision, arithmetic, choose_device, load_package
from perception.detection.model_files import DETECTOR, SEGMENTER, Role, find_model
from perception.detection.prompts import Prompt, make_prompts, separates, side_by_side
from perception.errors import ModelUnavailableError
from perception.frames import RgbdFrame
from perception.interfaces import Detection

# Means and spreads of ImageNet's RGB channels, 0..1; the published SAM 2 weights were trained with them.
IMAGENET_MEAN = np.array([0.485, 0.456, 0.406])
IMAGENET_STD = np.array([0.229, 0.224, 0.225])
# Score that GroundingDINO's authors cut at.
THRESHOLD = 0.25
# Work at once, so that memory does not grow with what is asked for: prompts about one picture, boxes in one.
PROMPTS_AT_ONCE = 4
BOXES_AT_ONCE = 32


class TransformersDetector:
    """Zero-shot detection with a model of the GroundingDINO family.

    Every phrase is scored by its own tokens: the mean over them of the probability that a box matches the token, so
    that "red cube" needs both words, and labels of different phrases cannot merge. Phrases of one prompt still see
    each other through the picture (its features are mixed with the whole text), so scores depend a little on what
    else is asked for; with one phrase a prompt they do not.
    """

    def __init__(
        self,
        model: str,
        offline: bool = False,
        threshold: float = THRESHOLD,
        most_boxes: int = 50,
        short_side: int | None = None,
        device: str = "auto",
        precision: Precision = "auto",
        most_phrases: int | None = None,
    ) -> None:
        """Remember the choice; weights are loaded by the first `detect`.

        Args:
            model: A folder, or a hub name such as "IDEA-Research/grounding-dino-tiny".
            offline: Never ask the hub.
            threshold: Lowest score of a box, 0..1.
            most_boxes: At most so many boxes per phrase.
            short_side: Picture's shorter side for the model in [px]; the model's own default if None.
            device: As in `perception.detection.devices.choose_device`.
            precision: As in `perception.detection.devices.arithmetic`.
            most_phrases: Most phrases in one prompt; as many as its text holds if None.
        """
        self.model = model
        self.offline = offline
        self.threshold = threshold
        self.most_boxes = most_boxes
        self.short_side = short_side
        self.device = device
        self.precision: Precision = precision
        self.most_phrases = most_phrases

    @property
    def name(self) -> str:
        """Says which weights answered."""
        return f"{self.model} (learned detector, transformers)"

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """All boxes above the threshold, best first; no phrases, no boxes.

        The picture's own features are computed once, however many prompts the phrases fill.

        Raises:
            ModelUnavailableError: The weights, packages or device are not on this machine, or are of another kind.
            UnknownPhraseError: A phrase without any word, or longer than a prompt.
        """
        if not phrases:
            return []
        torch = load_package("torch")
        device = choose_device(self.device)
        processor, network, memory = _load_detector(find_model(self.model, DETECTOR, self.offline), device)
        prompts = make_prompts(processor.tokenizer, phrases, _longest_prompt(network.config), self.most_phrases)
        size = {}
        if self.short_side:
            size["size"] = {"shortest_edge": self.short_side, "longest_edge": 2 * self.short_side}
        picture = processor.image_processor(images=np.array(frame.colour), return_tensors="pt", **size).to(device)
        found: list[Detection] = []
        try:
            with torch.inference_mode(), arithmetic(device, self.precision):
                for start in range(0, len(prompts), PROMPTS_AT_ONCE):
                    part = prompts[start : start + PROMPTS_AT_ONCE]
                    found += self._ask(torch, network, picture, part, processor.tokenizer.pad_token_id, frame)
        finally:
            memory.forget()
        return sorted(found, key=lambda d: -d.score)

    def _ask(
        self, torch: Any, network: Any, picture: Any, prompts: Sequence[Prompt], padding: int, frame: RgbdFrame
    ) -> list[Detection]:
        """Boxes for the phrases of a few prompts, in any order."""
        tokens, text = (torch.from_numpy(a).to(network.device) for a in side_by_side(prompts, padding))
        output = network(
            pixel_values=picture["pixel_values"].expand(len(prompts), -1, -1, -1),
            pixel_mask=picture["pixel_mask"].expand(len(prompts), -1, -1),
            input_ids=tokens,
            attention_mask=text,
            token_type_ids=torch.zeros_like(tokens),
        )
        match = output.logits.float().sigmoid().cpu().numpy()
        shares = output.pred_boxes.float().cpu().numpy()
        found = []
        for row, prompt in enumerate(prompts):
            boxes = _corner_boxes(shares[row], frame)
            large = np.all(boxes[:, 2:] - boxes[:, :2] >= 2.0, axis=1)
            for phrase, (first, after) in prompt.spans.items():
                scores = match[row, :, first:after].mean(1)
                if not np.isfinite(scores).all():
                    raise ModelUnavailableError(
                        f"'{self.model}' gives scores that are no numbers; use --precision single, or other weights"
                    )
                kept = np.nonzero(large & (scores >= self.threshold))[0]
                kept = kept[np.argsort(-scores[kept], kind="stable")][: self.most_boxes]
                found += [Detection(phrase, boxes[i], float(scores[i])) for i in kept]
        return found


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


class _PictureMemory:
    """Stands in for the `forward` of a GroundingDINO's backbone: one picture is computed once for all prompts.

    The network is given the picture as often as there are prompts, by views of one tensor; the backbone sees it once,
    and its answer is repeated.
    """

    def __init__(self, backbone: Callable) -> None:
        self._backbone = backbone
        self._last: tuple[Any, Any] | None = None

    def __call__(self, pixels: Any, mask: Any) -> tuple[list, list]:
        last = self._last
        if last is None or last[0].data_ptr() != pixels.data_ptr():
            # The tensor is kept with the answer, so that its address stays its own.
            last = self._last = (pixels, self._backbone(pixels[:1], mask[:1]))
        features, places = last[1]
        n = pixels.shape[0]
        repeated = [(f.expand(n, -1, -1, -1), m.expand(n, -1, -1)) for f, m in features]
        return repeated, [p.expand(n, -1, -1, -1) for p in places]

    def forget(self) -> None:
        """Give the memory of the last picture back."""
        self._last = None


def _longest_prompt(config: Any) -> int:
    """Most tokens that a text may have; positions restart with every phrase, so that the shorter limit is safe."""
    return min(int(config.max_text_len), int(config.text_config.max_position_embeddings))


def _corner_boxes(boxes: np.ndarray, frame: RgbdFrame) -> np.ndarray:
    """Boxes (centre x, centre y, width, height) in shares of the picture as corners in [px], shape (n, 4)."""
    width, height = frame.intrinsics.width, frame.intrinsics.height
    centre, half = boxes[:, :2], boxes[:, 2:] / 2
    corners = np.concatenate([centre - half, centre + half], 1) * [width, height, width, height]
    return np.clip(corners, 0.0, [width, height, width, height])


@functools.lru_cache(maxsize=4)
def _load_detector(folder: Path, device: str) -> tuple[Any, Any, _PictureMemory]:
    transformers = load_package("transformers")

    def load() -> tuple[Any, Any]:
        kind = transformers.AutoModelForZeroShotObjectDetection
        return transformers.AutoProcessor.from_pretrained(folder, local_files_only=True), _complete(kind, folder)

    processor, network = _ready(folder, DETECTOR, load, device)
    if not separates(processor.tokenizer, network.model.special_tokens.tolist()):
        raise ModelUnavailableError(
            f"the tokenizer in '{folder}' has other numbers for [CLS], [SEP] and '.' than the network cuts texts at "
            f"({network.model.special_tokens.tolist()}); its phrases would merge; use the tokenizer it was trained with"
        )
    memory = _PictureMemory(network.model.backbone.forward)
    network.model.backbone.forward = memory
    return processor, network, memory


@functools.lru_cache(maxsize=4)
def load_segmenter(folder: Path, device: str) -> tuple[Any, Any]:
    """Processor (None for SAM 2) and network of a folder that `find_model` found; once per process and device.

    Raises:
        ModelUnavailableError: The files cannot be loaded.
    """
    transformers = load_package("transformers")

    def load() -> tuple[Any, Any]:
        network = _complete(transformers.AutoModelForMaskGeneration, folder)
        if network.config.model_type != "sam":
            return None, network
        return transformers.AutoProcessor.from_pretrained(folder, local_files_only=True), network

    return _ready(folder, SEGMENTER, load, device)


def _complete(kind: Any, folder: Path) -> Any:
    """The network of a folder; transformers would only warn of absent weights, and fill them at random."""
    network, report = kind.from_pretrained(
        folder, local_files_only=True, use_safetensors=True, output_loading_info=True
    )
    missing = sorted(report["missing_keys"])
    if missing:
        raise ValueError(f"{len(missing)} of its weights are absent, the first is {missing[0]}")
    return network


def _ready(folder: Path, role: Role, load: Callable[[], tuple[Any, Any]], device: str) -> tuple[Any, Any]:
    """Load processor and network, for use only; weights saved in half precision are widened.

    Raises:
        ModelUnavailableError: With what is wrong with the files.
    """
    torch = load_package("torch")
    load_package("transformers").utils.logging.disable_progress_bar()
    try:
        processor, network = load()
    except ImportError as error:
        reason = str(error).strip().splitlines()[0]
        raise ModelUnavailableError(f"'{folder}' needs a package that is not installed: {reason}") from error
    except (OSError, ValueError, KeyError, RuntimeError, AttributeError, TypeError) as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise ModelUnavailableError(
            f"the folder '{folder}' does not hold a {role.name} ({role.needed}) that transformers can load: {reason}"
        ) from error
    return processor, network.to(device=device, dtype=torch.float32).eval()
