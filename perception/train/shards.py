"""Labelled pictures from shards, and their random changes.

What a shard holds: `sim_check/random_scenes/labelled_pictures.py`.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.errors import FrameError

FORMAT = "labelled-pictures-1"


@dataclass(frozen=True)
class Words:
    """What the numbers in shards mean.

    Attributes:
        nouns, colours: All words.
        kinds: What each kind of thing is called, the best noun first.
        may_be_called: The same and whatever else somebody might call it.
        alike_colours: Pairs of words for nearly the same colour.
    """

    nouns: tuple[str, ...]
    colours: tuple[str, ...]
    kinds: tuple[tuple[str, ...], ...]
    may_be_called: tuple[tuple[str, ...], ...]
    alike_colours: frozenset[frozenset[str]]


@dataclass(frozen=True)
class Thing:
    """One thing in a picture.

    Attributes:
        kind, colour: Numbers into `Words.kinds` and `Words.colours`.
        label: In the label picture.
        pixels: Visible ones in the whole picture.
        clear: Whether enough of it is visible to ask for it.
    """

    kind: int
    colour: int
    label: int
    pixels: int
    clear: bool


@dataclass(frozen=True)
class Sample:
    """One picture.

    Attributes:
        colour: RGB, uint8, shape (height, width, 3).
        labels: uint8, shape (height, width), 0 background.
        things: What it shows.
    """

    colour: NDArray[np.uint8]
    labels: NDArray[np.uint8]
    things: tuple[Thing, ...]


class Shards:
    """All pictures of several shard files, kept compressed in memory (about 30 kB each).

    Args:
        paths: Shard files.

    Raises:
        FrameError: A file that is no shard, or shards of different vocabularies.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._pictures: list[np.ndarray] = []
        self._labels: list[np.ndarray] = []
        self._things: list[np.ndarray] = []
        self.words: Words | None = None
        self._read: set[Path] = set()
        self.add(paths)

    def add(self, paths: Sequence[Path]) -> None:
        """Read further files; those already read are left out."""
        for path in paths:
            if path not in self._read:
                self._add(path)
                self._read.add(path)

    def _add(self, path: Path) -> None:
        try:
            with np.load(path, allow_pickle=False) as data:
                meta = json.loads(str(data["meta"]))
                words = _words(meta)
                if self.words is not None and words != self.words:
                    raise FrameError(f"'{path}' has another vocabulary than the other shards; render all of them again")
                self.words = words
                starts = np.r_[0, data["picture_ends"]]
                pictures = data["pictures"]
                self._pictures += [pictures[a:b].copy() for a, b in pairwise(starts)]
                ends = np.r_[0, data["label_ends"]]
                labels = data["labels"]
                self._labels += [labels[a:b].copy() for a, b in pairwise(ends)]
                things = data["things"]
                self._things += [things[things[:, 0] == k] for k in range(len(starts) - 1)]
        except (OSError, ValueError, KeyError) as error:
            raise FrameError(f"'{path}' is not a shard of labelled pictures: {error}") from error

    def __len__(self) -> int:
        return len(self._pictures)

    def sample(self, index: int) -> Sample:
        """One picture as it was rendered."""
        colour = cv2.imdecode(self._pictures[index], cv2.IMREAD_COLOR)
        labels = cv2.imdecode(self._labels[index], cv2.IMREAD_GRAYSCALE)
        assert colour is not None and labels is not None
        counts = np.bincount(labels.ravel(), minlength=256)
        things = tuple(
            Thing(int(r[2]), int(r[3]), int(r[1]), int(counts[r[1]]), bool(r[9])) for r in self._things[index]
        )
        return Sample(np.ascontiguousarray(colour[:, :, ::-1], np.uint8), np.asarray(labels, np.uint8), things)


def _words(meta: dict) -> Words:
    if meta.get("format") != FORMAT:
        raise ValueError(f"its format is {meta.get('format')!r}, not {FORMAT!r}")
    return Words(
        tuple(meta["nouns"]),
        tuple(meta["colours"]),
        tuple(tuple(k) for k in meta["kinds"]),
        tuple(tuple(k) for k in meta["may_be_called"]),
        frozenset(frozenset(p) for p in meta["alike_colours"]),
    )


def cropped(sample: Sample, size: tuple[int, int], rng: np.random.Generator, least: float = 0.55) -> Sample:
    """A random part of a picture, perhaps mirrored, at a fixed size.

    Things of which less than half remains are no longer clear.

    Args:
        sample: The whole.
        size: (width, height) of the result in [px].
        rng: Source of randomness.
        least: Smallest part, as a share of the sides.
    """
    height, width = sample.labels.shape
    share = rng.uniform(least, 1.0) if rng.random() < 0.8 else 1.0
    h = max(8, int(height * share))
    w = max(8, min(width, int(width * share * rng.uniform(0.88, 1.12))))
    y, x = int(rng.integers(0, height - h + 1)), int(rng.integers(0, width - w + 1))
    colour = cv2.resize(sample.colour[y : y + h, x : x + w], size, interpolation=cv2.INTER_AREA)
    cut = sample.labels[y : y + h, x : x + w]
    left = np.bincount(cut.ravel(), minlength=256)
    labels = cv2.resize(cut, size, interpolation=cv2.INTER_NEAREST)
    if rng.random() < 0.5:
        colour, labels = colour[:, ::-1], labels[:, ::-1]
    things = tuple(
        Thing(t.kind, t.colour, t.label, t.pixels, t.clear and bool(left[t.label] >= 0.5 * t.pixels))
        for t in sample.things
        if left[t.label] > 0
    )
    return Sample(np.ascontiguousarray(colour, np.uint8), np.ascontiguousarray(labels, np.uint8), things)


def tinted(colour: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The picture under another exposure and white balance, a little blurred or noisy; uint8, same shape."""
    picture = colour.astype(np.float32) * rng.uniform(0.72, 1.22) * (1.0 + rng.normal(0.0, 0.035, 3).astype(np.float32))
    if rng.random() < 0.3:
        picture = cv2.GaussianBlur(picture, (0, 0), float(rng.uniform(0.4, 1.1)))
    if rng.random() < 0.5:
        picture += rng.normal(0.0, rng.uniform(1.0, 8.0), (*colour.shape[:2], 1)).astype(np.float32)
    return np.clip(picture, 0, 255).astype(np.uint8)
