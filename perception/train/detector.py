"""Training of the bundled detector."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from perception.detection.devices import load_package
from perception.detection.hf_segmenter import IMAGENET_MEAN, IMAGENET_STD
from perception.train.loop import TrainingSettings, run_training
from perception.train.losses import cell_owners, dense_loss, matched_loss
from perception.train.networks import detector_processor, new_detector
from perception.train.questions import ask
from perception.train.shards import Sample, Shards, cropped, tinted
from perception.train.vocabulary import known_words, make_tokenizer

SIDES = (320, 240)  # width and height of training pictures in [px]
MAP_WEIGHT = 0.5  # of the auxiliary map of nouns and colours


@dataclass(frozen=True)
class DetectorTraining:
    """Settings.

    Attributes:
        steps: Planned number of steps.
        batch: Pictures a step.
        learning_rate: Full rate of AdamW.
        seed: Of weights, pictures and questions.
        half: Whether to calculate in bfloat16 where torch's autocast allows it.
        save_every: Steps between checkpoints.
        width, depth, queries: Of the network.
    """

    steps: int = 20_000
    batch: int = 16
    learning_rate: float = 1.5e-3
    seed: int = 0
    half: bool = True
    save_every: int = 500
    width: int = 32
    depth: int = 64
    queries: int = 48


@dataclass
class Batch:
    """Pictures, phrases and answers, ready for the network.

    Attributes:
        pixels: Normalised pictures, shape (batch, 3, height, width).
        text: Input ids and attention mask.
        wanted: True boxes of each picture, (cx, cy, w, h) in 0..1, each (things, 4).
        tokens: Which tokens name each thing, each (things, tokens).
        samples: As drawn.
        asked: Number of each thing asked for, into the sample's things.
    """

    pixels: Any
    text: Any
    wanted: list[Any] = field(default_factory=list)
    tokens: list[Any] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    asked: list[list[int]] = field(default_factory=list)


def boxes_of(sample: Sample, numbers: list[int]) -> np.ndarray:
    """Boxes around the visible pixels of some of a sample's things, (x0, y0, x1, y1) in [px], float, shape (n, 4)."""
    boxes = np.zeros((len(numbers), 4))
    for k, number in enumerate(numbers):
        mask = sample.labels == sample.things[number].label
        columns, rows = np.nonzero(mask.any(0))[0], np.nonzero(mask.any(1))[0]
        if len(columns):
            boxes[k] = (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1)
    return boxes


def draw_batch(shards: Shards, tokenizer: Any, size: int, rng: np.random.Generator) -> Batch:
    """Pictures at random with questions about them."""
    torch = load_package("torch")
    assert shards.words is not None
    samples, questions = [], []
    while len(samples) < size:
        sample = cropped(shards.sample(int(rng.integers(len(shards)))), SIDES, rng)
        asked = ask(sample.things, shards.words, rng)
        if asked:
            samples.append(sample)
            questions.append(asked)
    texts = [". ".join(q.phrase for q in asked) + "." for asked in questions]
    text = tokenizer(texts, padding=True, return_tensors="pt")
    pictures = np.stack([tinted(s.colour, rng) for s in samples])
    normal = (pictures / 255.0 - IMAGENET_MEAN) / IMAGENET_STD
    batch = Batch(torch.tensor(normal.transpose(0, 3, 1, 2), dtype=torch.float32), text)
    batch.pixels = batch.pixels.contiguous(memory_format=torch.channels_last)
    length = text["input_ids"].shape[1]
    for sample, asked in zip(samples, questions, strict=True):
        numbers = sorted({n for q in asked for n in q.answers})
        boxes = boxes_of(sample, numbers)
        tokens = np.zeros((len(numbers), length), np.float32)
        position = 1  # token 0 marks the beginning
        for question in asked:
            count = len(tokenizer(question.phrase, add_special_tokens=False)["input_ids"])
            for n in question.answers:
                tokens[numbers.index(n), position : position + count] = 1.0
            position += count + 1
        shown = boxes[:, 2] > boxes[:, 0]
        scale = np.array([*SIDES, *SIDES], float)
        middle, extent = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
        shares = np.concatenate([middle, extent], 1) / scale
        batch.wanted.append(torch.tensor(shares[shown], dtype=torch.float32))
        batch.tokens.append(torch.tensor(tokens[shown]))
        batch.samples.append(sample)
        batch.asked.append([n for n, s in zip(numbers, shown, strict=True) if s])
    return batch


class DetectorLoss:
    """The whole loss of a batch; holds the auxiliary head, which is thrown away after training.

    Args:
        model: The network.
        kinds, colours: How many nouns and colours the auxiliary map tells apart.
    """

    def __init__(self, model: Any, kinds: int, colours: int) -> None:
        torch = load_package("torch")
        self.model = model
        self.kinds, self.colours = kinds, colours
        channels = model.config.backbone_config.hidden_sizes[1:]
        self.head = torch.nn.ModuleList(
            [
                *[torch.nn.Conv2d(c, 64, 1) for c in channels],
                torch.nn.Conv2d(64, 64, 3, padding=1),
                torch.nn.Conv2d(64, kinds + colours + 2, 1),
            ]
        )
        self._maps: Any = None
        model.model.backbone.register_forward_hook(self._keep)

    def _keep(self, module: Any, inputs: Any, output: Any) -> None:
        self._maps = [m[0] if isinstance(m, tuple) else m for m in _feature_maps(output)]

    def __call__(self, batch: Batch, half: bool) -> tuple[Any, dict[str, float]]:
        """Loss and its parts."""
        torch = load_package("torch")
        model = self.model
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=half):
            out = model(pixel_values=batch.pixels, **batch.text)
            length = batch.text["input_ids"].shape[1]
            text = batch.text["attention_mask"].bool()
            states = out.intermediate_hidden_states
            layers = []
            for k in range(states.shape[1]):
                before = out.init_reference_points if k == 0 else out.intermediate_reference_points[:, k - 1]
                logits = model.class_embed[k](
                    vision_hidden_state=states[:, k],
                    text_hidden_state=out.encoder_last_hidden_state_text,
                    text_token_mask=text,
                )[..., :length]
                boxes = (
                    model.bbox_embed[k](states[:, k]).float() + torch.special.logit(before.float(), eps=1e-5)
                ).sigmoid()
                layers.append((logits, boxes))
            maps = self._map_logits()
        parts = {}
        for k, (logits, boxes) in enumerate(layers):
            parts[f"layer{k}"] = matched_loss(logits.float(), boxes, batch.wanted, batch.tokens, text)
        cells = out.enc_outputs_class[..., :length].float()
        offsets = out.enc_outputs_coord_logits.float()
        inside = torch.isfinite(offsets).all(-1) & (offsets.abs() < 1e4).all(-1)
        proposals = torch.where(inside[..., None], offsets, torch.zeros_like(offsets)).sigmoid()
        shapes = [tuple(m.shape[-2:]) for m in self._maps]
        owner = np.stack(
            [
                cell_owners(s.labels, boxes_of(s, n), [s.things[i].label for i in n], shapes)
                for s, n in zip(batch.samples, batch.asked, strict=True)
            ]
        )
        owner = torch.as_tensor(owner)
        owner = torch.where(inside, owner, torch.full_like(owner, -2))
        parts["cells"] = dense_loss(
            cells.masked_fill(~torch.isfinite(cells), -20.0), proposals, owner, batch.wanted, batch.tokens, text
        )
        parts["map"] = MAP_WEIGHT * self._map_loss(maps.float(), batch.samples)
        total = sum(parts.values())
        return total, {k: float(v.detach()) for k, v in parts.items()}

    def _map_logits(self) -> Any:
        torch = load_package("torch")
        fine = self.head[0](self._maps[0])
        for k in (1, 2):
            coarse = self.head[k](self._maps[k])
            fine = fine + torch.nn.functional.interpolate(coarse, size=fine.shape[-2:], mode="bilinear")
        gelu = torch.nn.functional.gelu
        return self.head[4](gelu(self.head[3](gelu(fine))))

    def _map_loss(self, logits: Any, samples: list[Sample]) -> Any:
        """Cross entropy of what kind and colour each cell of the finest map shows, background counting less."""
        torch = load_package("torch")
        rows, columns = logits.shape[-2:]
        kinds, colours = [], []
        for s in samples:
            kind_of, colour_of = np.zeros(256, np.int64), np.zeros(256, np.int64)
            for thing in s.things:
                kind_of[thing.label], colour_of[thing.label] = thing.kind + 1, thing.colour + 1
            y = ((np.arange(rows) + 0.5) * s.labels.shape[0] / rows).astype(int)
            x = ((np.arange(columns) + 0.5) * s.labels.shape[1] / columns).astype(int)
            cells = s.labels[y[:, None], x[None]]
            kinds.append(kind_of[cells])
            colours.append(colour_of[cells])
        loss = torch.nn.functional.cross_entropy
        weight = torch.ones(self.kinds + 1)
        weight[0] = 0.3
        shade = torch.ones(self.colours + 1)
        shade[0] = 0.3
        return loss(logits[:, : self.kinds + 1], torch.as_tensor(np.stack(kinds)), weight=weight) + loss(
            logits[:, self.kinds + 1 :], torch.as_tensor(np.stack(colours)), weight=shade
        )


def quicken(model: Any) -> None:
    """Lay the backbone out for CPUs: channels last, and depthwise convolutions in single precision.

    Backwards, a depthwise convolution takes half as long that way.
    """
    torch = load_package("torch")
    model.model.backbone.to(memory_format=torch.channels_last)

    def single(conv: Any, pixels: Any) -> Any:
        with torch.autocast("cpu", enabled=False):
            return type(conv).forward(conv, pixels.float())

    for module in model.model.backbone.modules():
        if isinstance(module, torch.nn.Conv2d) and module.groups > 1:
            module.forward = functools.partial(single, module)


def _feature_maps(output: Any) -> list[Any]:
    """The backbone's maps, the finest first, whatever this version wraps them in."""
    if hasattr(output, "feature_maps"):
        return list(output.feature_maps)
    first = output[0] if isinstance(output, tuple) else output
    return list(first)


def train_detector(
    folder: Path, paths: Callable[[], list[Path]], settings: DetectorTraining, say: Callable[[str], None]
) -> Path:
    """Train, or go on training, until the planned number of steps.

    Args:
        folder: For `detector.pt`, the checkpoint; a training found there goes on.
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
    assert shards.words is not None
    words = shards.words
    tokenizer = make_tokenizer(known_words(words.nouns, words.colours))
    model = new_detector(len(tokenizer), settings.width, settings.depth, settings.queries)
    loss_of = DetectorLoss(model, len(words.kinds), len(words.colours))
    weights = [*(p for p in model.parameters() if p.requires_grad), *loss_of.head.parameters()]
    optimiser = torch.optim.AdamW(weights, lr=settings.learning_rate, weight_decay=1e-4, betas=(0.9, 0.98))
    trained = run_training(
        folder / "detector.pt",
        model,
        weights,
        optimiser,
        {"head": loss_of.head},
        lambda rng: loss_of(draw_batch(shards, tokenizer, settings.batch, rng), settings.half),
        lambda: shards.add(paths()),
        TrainingSettings(settings.steps, settings.learning_rate, settings.seed, settings.save_every),
        say,
        quicken,
    )
    out = folder / "detector"
    save_detector(trained, tokenizer, out)
    return out


def save_detector(model: Any, tokenizer: Any, out: Path) -> None:
    """Write weights in half precision, configuration and processor, as transformers loads them."""
    import copy

    slim = copy.deepcopy(model).half()
    slim.save_pretrained(out)
    detector_processor(tokenizer, 360, 480).save_pretrained(out)
