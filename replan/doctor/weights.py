"""Which weights are where: bundled ones, those in the hub client's store, and folders. Loads no network."""

import importlib.util
from dataclasses import dataclass
from pathlib import Path

from perception.detection import bundled
from perception.detection.bundled import DetectorCard, SegmenterCard, read_card
from perception.detection.model_files import (
    DETECTOR,
    SEGMENTER,
    Role,
    cached_folder,
    check_architecture,
    fetch_command,
    find_model,
    size_on_disk,
)
from perception.errors import ModelUnavailableError
from replan_base.parts import install_part

# Published models that perception knows how to load, and what each is for.
PUBLISHED = {
    "IDEA-Research/grounding-dino-base": DETECTOR,
    "IDEA-Research/grounding-dino-tiny": DETECTOR,
    "openmmlab-community/mm_grounding_dino_tiny_o365v1_goldg_v3det": DETECTOR,
    "facebook/sam-vit-base": SEGMENTER,
    "facebook/sam2-hiera-tiny": SEGMENTER,
    "facebook/sam2.1-hiera-tiny": SEGMENTER,
}


@dataclass(frozen=True)
class Weights:
    """What is known about one set of weights.

    Attributes:
        name: As people call it.
        here: Whether it can be used.
        detail: Its place, size and figures, or why it cannot be used.
        command: What fetches it, where that is known.
    """

    name: str
    here: bool
    detail: str
    command: str = ""


def examine_weights(detector: str, segmenter: str) -> list[Weights]:
    """Embedded, bundled and published weights, and those that were asked about.

    Args:
        detector, segmenter: As given to `replan run`; a folder or another hub name is looked at as well.
    """
    found = [
        Weights("colour-and-shape detector", True, "embedded; not a learned model"),
        Weights("GrabCut-and-depth masks", True, "embedded; not a learned model"),
        _bundled(bundled.DETECTOR_FOLDER, DETECTOR),
        _bundled(bundled.SEGMENTER_FOLDER, SEGMENTER),
    ]
    asked = {detector: DETECTOR, segmenter: SEGMENTER}
    words = ("default", "colour", "grabcut", "bundled")
    found += [_asked(name, role) for name, role in asked.items() if name not in (*words, *PUBLISHED)]
    return found + [_published(name, role) for name, role in PUBLISHED.items()]


def _bundled(folder: Path, role: Role) -> Weights:
    name = f"bundled {role.name}"
    try:
        card = read_card(folder, DetectorCard if role is DETECTOR else SegmenterCard)
        check_architecture(folder, str(folder), role)
    except ModelUnavailableError as error:
        return Weights(name, False, str(error))
    figures = ", ".join(f"{key} {value:g}" for key, value in card.figures.items())
    return Weights(name, True, f"{card.name} of {card.made}, {_place(folder)}; {figures or 'no figures'}")


def _asked(name: str, role: Role) -> Weights:
    try:
        folder = find_model(name, role, offline=True)
    except ModelUnavailableError as error:
        return Weights(name, False, str(error))
    return Weights(name, True, f"{role.name}, {_place(folder)}")


def _published(name: str, role: Role) -> Weights:
    if importlib.util.find_spec("huggingface_hub") is None:
        return Weights(name, False, f"{role.name}; huggingface_hub is not installed; run: {install_part('perception')}")
    folder = cached_folder(name)
    if folder is None:
        return Weights(name, False, f"{role.name}, not on this machine", fetch_command(name))
    return Weights(name, True, f"{role.name}, {_place(folder)}")


def _place(folder: Path) -> str:
    return f"{size_on_disk(folder) / 1e6:.0f} MB in {folder}"
