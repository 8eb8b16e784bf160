"""Training of the bundled segmenter: masks of things in crops around loose boxes."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from perception.detection.crop_segmenter import Window, box_in_crop, crop_picture, square_window
from perception.detection.devices import load_package
from perception.detection.hf_segmenter import IMAGENET_MEAN, IMAGENET_STD
from perception.train.loop import TrainingSettings, run_training
from perception.train.networks import SAM_SIDE, new_segmenter
from perception.train.shards import Sample, Shards, tinted

CROP_FACTOR = 1.4  # side of the crop over the longer side of the box
LOOSE = 0.08  # how far the edges of training boxes are off, as a share of the box's sides
LEAST_PIXELS = 60  # of things that are trained on, in a picture 480 px wide


@dataclass(frozen=True)
class SegmenterTraining:
    """Settings.

    Attributes:
        steps: Planned number of steps.
        batch: Crops a step.
        learning_rate: Full rate of AdamW.
        seed: Of weights, crops and boxes.
        half: Whether to calculate in bfloat16 where torch's autocast allows it.
        save_every: Steps between checkpoints.
    """

    steps: int = 12_000
    batch: int = 24
    learning_rate: float = 1e-3
    seed: int = 0
    half: bool = True
    save_every: int = 500


def draw_crop(sample: Sample, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """One thing of a picture, cut out around a loose box.

    Returns:
        Crop (RGB, uint8, shape (side, side, 3)), box in it ((x0, y0, x1, y1) in [px], shape (4,)), mask (bool, shape
        (side, side)); None when the picture shows nothing clear.
    """
    clear = [t for t in sample.things if t.clear and t.pixels >= LEAST_PIXELS]
    if not clear:
        return None
    thing = clear[int(rng.integers(len(clear)))]
    mask = sample.labels == thing.label
    columns, rows = np.nonzero(mask.any(0))[0], np.nonzero(mask.any(1))[0]
    box = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], float)
    sides = np.tile(box[2:] - box[:2], 2)
    box += rng.uniform(-LOOSE, LOOSE, 4) * sides
    window = square_window(box, CROP_FACTOR)
    crop = crop_picture(sample.colour, window, SAM_SIDE)
    cut = _cut_mask(mask, window)
    inside = box_in_crop(box, window, SAM_SIDE)
    if rng.random() < 0.5:
        crop, cut = crop[:, ::-1], cut[:, ::-1]
        inside[[0, 2]] = SAM_SIDE - inside[[2, 0]]
    return tinted(np.ascontiguousarray(crop), rng), inside, cut


def _cut_mask(mask: np.ndarray, window: Window) -> np.ndarray:
    """A window of a mask at the size of a crop, bool; nothing lies out of the picture."""
    left, top, size = window
    shift = np.array([[SAM_SIDE / size, 0.0, 0.0], [0.0, SAM_SIDE / size, 0.0]])
    # Pixel centres: (x + 0.5) is scaled, not x.
    shift[:, 2] = (0.5 - np.array([left, top])) * SAM_SIDE / size - 0.5
    cut = cv2.warpAffine(mask.astype(np.float32), shift, (SAM_SIDE, SAM_SIDE), flags=cv2.INTER_LINEAR)
    return cut > 0.5


def draw_crops(shards: Shards, size: int, rng: np.random.Generator) -> tuple[Any, Any, Any]:
    """Normalised crops (n, 3, side, side), boxes (n, 1, 4) in [px] and masks (n, side, side), 0 or 1."""
    torch = load_package("torch")
    drawn = []
    while len(drawn) < size:
        one = draw_crop(shards.sample(int(rng.integers(len(shards)))), rng)
        if one is not None:
            drawn.append(one)
    normal = (np.stack([c for c, _, _ in drawn]) / 255.0 - IMAGENET_MEAN) / IMAGENET_STD
    boxes = np.stack([b for _, b, _ in drawn])[:, None]
    masks = np.stack([m for _, _, m in drawn])
    return (
        torch.tensor(normal.transpose(0, 3, 1, 2), dtype=torch.float32),
        torch.tensor(boxes, dtype=torch.float32),
        torch.tensor(masks, dtype=torch.float32),
    )


def mask_loss(model: Any, pixels: Any, boxes: Any, masks: Any, half: bool) -> tuple[Any, float]:
    """Cross entropy, Dice loss and the error of the predicted IoU, as SAM is trained; and the mean IoU.

    Args:
        model: A SAM.
        pixels, boxes, masks: As `draw_crops` gives them.
        half: Whether to calculate in bfloat16.
    """
    torch = load_package("torch")
    with torch.autocast("cpu", dtype=torch.bfloat16, enabled=half):
        out = model(pixel_values=pixels, input_boxes=boxes, multimask_output=False)
    logits = out.pred_masks[:, 0, 0].float()
    wanted = torch.nn.functional.interpolate(masks[:, None], size=logits.shape[-2:], mode="area")[:, 0]
    p = logits.sigmoid()
    dice = 1 - (2 * (p * wanted).sum((1, 2)) + 1) / (p.sum((1, 2)) + wanted.sum((1, 2)) + 1)
    entropy = torch.nn.functional.binary_cross_entropy_with_logits(logits, wanted)
    with torch.no_grad():
        on, true = logits > 0, wanted > 0.5
        iou = (on & true).sum((1, 2)) / ((on | true).sum((1, 2)) + 1e-6)
    guess = ((out.iou_scores[:, 0, 0].float() - iou) ** 2).mean()
    return 5 * entropy + dice.mean() + guess, float(iou.mean())


def train_segmenter(
    folder: Path, paths: Callable[[], list[Path]], settings: SegmenterTraining, say: Callable[[str], None]
) -> Path:
    """Train, or go on training, until the planned number of steps.

    Args:
        folder: For `segmenter.pt`, the checkpoint; a training found there goes on.
        paths: Gives the shards there are by now; asked again at every checkpoint.
        settings: Of the training.
        say: Progress.

    Returns:
        Folder with the trained weights, loadable by transformers.

    Raises:
        FrameError: No shards, or damaged ones, or a checkpoint of another network.
        KeyboardInterrupt: After the checkpoint has been saved.
    """
    torch = load_package("torch")
    torch.manual_seed(settings.seed)
    shards = Shards(paths())
    model = new_segmenter()
    optimiser = torch.optim.AdamW(model.parameters(), lr=settings.learning_rate, weight_decay=1e-3)

    def loss_of(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
        loss, iou = mask_loss(model, *draw_crops(shards, settings.batch, rng), settings.half)
        return loss, {"IoU of crops": iou}

    trained = run_training(
        folder / "segmenter.pt",
        model,
        model.parameters(),
        optimiser,
        {},
        loss_of,
        lambda: shards.add(paths()),
        TrainingSettings(settings.steps, settings.learning_rate, settings.seed, settings.save_every),
        say,
    )
    out = folder / "segmenter"
    save_segmenter(trained, out)
    return out


def save_segmenter(model: Any, out: Path) -> None:
    """Write weights in half precision and the configuration, as transformers loads them, and how to crop."""
    import copy
    import json

    transformers = load_package("transformers")
    side = {"height": SAM_SIDE, "width": SAM_SIDE}
    pictures = transformers.SamImageProcessor(size={"longest_edge": SAM_SIDE}, pad_size=side)
    copy.deepcopy(model).half().save_pretrained(out)
    transformers.SamProcessor(pictures).save_pretrained(out)
    (out / "replan.json").write_text(json.dumps({"crop_factor": CROP_FACTOR}) + "\n")
