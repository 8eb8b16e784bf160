"""The page beside bundled weights that tells people what they are, from the card that programs read."""

from perception.catalogue.catalogue import builtin_catalogue
from perception.detection.bundled import DetectorCard, ModelCard

DATA = """## Data

Pictures rendered with MuJoCo by `sim_check.random_scenes.labelled_pictures`: random things of the object library
({objects}), cabinets, microwaves, levers and
weight plates, in random sizes, shades, places and stacks, with nameless clutter and sometimes a robot arm; random
surfaces, lights and cameras (0.4 to 1.4 m away, 18 to 78 degrees above the horizon). No photograph, no downloaded
weights, no text corpus. Figures come from pictures of seeds that were never trained on. To train again: `python -m
perception.train`, then `python -m perception.train publish`.
"""

DETECTOR_LIMITS = """## Limits

- It knows the nouns and colour words of `card.json` and nothing else; other phrases are refused by name.
- It has seen renders only. On photographs it is not measured and is not meant to be used: take a published
  GroundingDINO there (`--detector IDEA-Research/grounding-dino-base`).
- Small things far away (under about 15 px in a picture 640 px wide) are missed.
- Scores are low (0.2 to 0.7) and are no probabilities; the threshold of the card belongs to them.
- The network is MM-GroundingDINO without the feature enhancer: pictures and text meet in the proposals and in the
  decoder only.
"""

SEGMENTER_LIMITS = """## Limits

- It has seen renders only, in crops of 128 px around boxes that were loose by up to 8 % of their sides.
- One mask a box; no points, no second guess.
- Photographs: take a published SAM (`--segmenter facebook/sam-vit-base`).
"""


def page(card: ModelCard) -> str:
    """The page as Markdown."""
    rows = "\n".join(f"| {name.replace('_', ' ')} | {value:g} |" for name, value in card.figures.items())
    lines = [f"# {card.name}", "", f"Made on {card.made.isoformat()}; {card.trained_on}.", ""]
    if isinstance(card, DetectorCard):
        lines += [
            f"Nouns: {', '.join(card.nouns)}. Colours: {', '.join(card.colours)}. Threshold {card.threshold:g}.",
            "",
        ]
    objects = ", ".join(noun for noun, entry in builtin_catalogue().objects.items() if entry.drawn)
    lines += ["| on held-out pictures | |", "|---|---|", rows, "", DATA.format(objects=objects)]
    return "\n".join(lines) + "\n" + (DETECTOR_LIMITS if isinstance(card, DetectorCard) else SEGMENTER_LIMITS)
