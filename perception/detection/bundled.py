"""The project's own small weights: where they lie in the package, what their cards say, and what they can look for.

They were trained on rendered scenes with a fixed list of nouns and colour words. A card beside the weights
(`card.json`) lists these words; anything else is refused by name rather than guessed.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from perception.catalogue.catalogue import builtin_catalogue
from perception.detection.devices import Precision
from perception.errors import ModelUnavailableError, UnknownPhraseError
from perception.frames import RgbdFrame
from perception.interfaces import Detection, Segmenter

WEIGHTS = Path(__file__).parents[1] / "weights"
DETECTOR_FOLDER = WEIGHTS / "detector"
SEGMENTER_FOLDER = WEIGHTS / "segmenter"
CARD_FILE = "card.json"
# What "default" means for a segmenter; for a detector it is `perception.detection.detector_router`.
DEFAULT_SEGMENTER = "grabcut"


class ModelCard(BaseModel):
    """What is known about bundled weights.

    Attributes:
        name: What they are, for people.
        made: Day of the training.
        trained_on: Which pictures, in a sentence.
        figures: Measured figures by name, with the unit in the name.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    name: str = Field(min_length=1)
    made: date
    trained_on: str = Field(min_length=1)
    figures: dict[str, float]


class DetectorCard(ModelCard):
    """Card of a detector.

    Attributes:
        nouns: What it was trained to find; a noun may be several words.
        colours: Colour words that it was trained with.
        fillers: Words that may stand in a phrase and are not shown to the network.
        threshold: Lowest score of a box, 0..1, chosen on pictures apart from those of the training.
        most_phrases: Most phrases in one prompt, as in its training; any number if absent.
        short_side: Shorter side of the pictures that it was trained with in [px]; as its processor says if absent.
    """

    nouns: tuple[str, ...] = Field(min_length=1)
    colours: tuple[str, ...]
    fillers: tuple[str, ...] = ("a", "an", "the")
    threshold: float = Field(ge=0.0, le=1.0)
    most_phrases: int | None = Field(default=None, ge=1)
    short_side: int | None = Field(default=None, ge=32)


class SegmenterCard(ModelCard):
    """Card of a segmenter."""


C = TypeVar("C", bound=ModelCard)


def read_card(folder: Path, kind: type[C]) -> C:
    """The card beside bundled weights.

    Raises:
        ModelUnavailableError: This package came without these weights, or the card is not valid.
    """
    path = folder / CARD_FILE
    try:
        return kind.model_validate(json.loads(path.read_text()))
    except OSError as error:
        other = "colour" if kind is DetectorCard else "grabcut"
        raise ModelUnavailableError(
            f"this package has no bundled {folder.name} ({path} is not there); "
            f"say --{folder.name} {other}, or give a folder or hub name (see docs/models.md)"
        ) from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(k) for k in first["loc"])
        raise ModelUnavailableError(f"the card {path} is not valid: {where}: {first['msg']}") from error
    except ValueError as error:
        raise ModelUnavailableError(f"the card {path} is not JSON: {error}") from error


class BundledDetector:
    """The project's own detector: a small network of the GroundingDINO family that knows the words of its card."""

    def __init__(
        self,
        folder: Path,
        threshold: float | None = None,
        device: str = "auto",
        precision: Precision = "auto",
    ) -> None:
        """Read the card; weights are loaded by the first `detect`.

        Args:
            folder: Weights with a card.
            threshold: Lowest score of a box, 0..1; the card's if None.
            device: As in `perception.detection.devices.choose_device`.
            precision: As in `perception.detection.devices.arithmetic`.

        Raises:
            ModelUnavailableError: This package came without the weights, or the card is not valid.
        """
        from perception.detection.hf_detector import TransformersDetector

        self.card = read_card(folder, DetectorCard)
        self._network = TransformersDetector(
            str(folder),
            offline=True,
            threshold=self.card.threshold if threshold is None else threshold,
            short_side=self.card.short_side,
            device=device,
            precision=precision,
            most_phrases=self.card.most_phrases,
        )

    @property
    def name(self) -> str:
        """Says which weights answered."""
        return f"{self.card.name} (bundled, learned on rendered scenes)"

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """All boxes above the threshold, best first.

        Raises:
            UnknownPhraseError: A phrase with a word that the network was not trained with.
            ModelUnavailableError: Packages or device are not on this machine.
        """
        words = {phrase: self.known_words(phrase) for phrase in dict.fromkeys(phrases)}
        found = self._network.detect(frame, tuple(dict.fromkeys(words.values())))
        return [replace(d, phrase=p) for d in found for p, asked in words.items() if asked == d.phrase]

    def known_words(self, phrase: str) -> str:
        """A phrase as the network was trained to read it: colours and a noun, "the gray cube" as "grey cube".

        Raises:
            UnknownPhraseError: It holds other words, or no noun.
        """
        card, aliases = self.card, builtin_catalogue().colour_aliases
        rest = [
            "".join(c for c in w if c.isalnum()) for w in phrase.lower().replace("_", " ").replace("-", " ").split()
        ]
        rest = [w for w in rest if w and w not in card.fillers]
        colours: list[str] = []
        while rest and " ".join(rest) not in card.nouns:
            word = rest[0] if rest[0] in card.colours else aliases.get(rest[0], rest[0])
            if word not in card.colours:
                break
            colours.append(word)
            rest = rest[1:]
        if " ".join(rest) not in card.nouns:
            raise UnknownPhraseError(
                f"the bundled detector cannot look for '{phrase}': it was trained with the nouns {sorted(card.nouns)} "
                f"and the colours {sorted(card.colours)}; say colours and one of the nouns, or choose another detector"
            )
        return " ".join((*colours, *rest))


def bundled_segmenter(folder: Path, device: str = "auto", precision: Precision = "auto") -> Segmenter:
    """The project's own segmenter, on crops or on whole pictures as its `replan.json` says.

    Args:
        folder: Weights with a card.
        device: As in `perception.detection.devices.choose_device`.
        precision: As in `perception.detection.devices.arithmetic`.

    Raises:
        ModelUnavailableError: This package came without the weights, or the card or settings are not valid.
    """
    from perception.detection.crop_segmenter import CropSegmenter, read_crop_settings
    from perception.detection.hf_segmenter import TransformersSegmenter

    card = read_card(folder, SegmenterCard)
    settings = read_crop_settings(folder)
    if settings is None:
        return TransformersSegmenter(str(folder), offline=True, device=device, precision=precision)
    name = f"{card.name} (bundled, learned on rendered scenes)"
    return CropSegmenter(folder, settings, device, precision, name)
