"""Learned detectors through `transformers`: the GroundingDINO family.

Weights are loaded at first use and once per process and device. Nothing heavy is imported before that.
"""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from perception.detection.devices import Precision, arithmetic, choose_device, load_package
from perception.detection.hf_loading import complete_network, loaded
from perception.detection.model_files import DETECTOR, find_model
from perception.detection.prompts import Prompt, make_prompts, separates, side_by_side
from perception.errors import ModelUnavailableError
from perception.frames import RgbdFrame
from perception.interfaces import Detection

# Score that GroundingDINO's authors cut at.
THRESHOLD = 0.25
PROMPTS_AT_ONCE = 4  # about one picture, so that memory does not grow with what is asked for


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
        return transformers.AutoProcessor.from_pretrained(folder, local_files_only=True), complete_network(kind, folder)

    processor, network = loaded(folder, DETECTOR, load, device)
    if not separates(processor.tokenizer, network.model.special_tokens.tolist()):
        raise ModelUnavailableError(
            f"the tokenizer in '{folder}' has other numbers for [CLS], [SEP] and '.' than the network cuts texts at "
            f"({network.model.special_tokens.tolist()}); its phrases would merge; use the tokenizer it was trained with"
        )
    memory = _PictureMemory(network.model.backbone.forward)
    network.model.backbone.forward = memory
    return processor, network, memory
