"""How an episode ended, as its simulated cell and its record tell: what scorers judge."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from perception.ground_truth import CellTruth
from sim_check.furniture.model import FurnitureModel


@dataclass(frozen=True)
class Ending:
    """Everything that a scorer may look at.

    Attributes:
        before, after: What truly stood in the cell when the run began and when it ended.
        furniture: Models of the cell's furniture, for its insides, by name.
        claimed: Whether the run says that it reached its goal.
        estimates: Where the run believes things to be: the last estimate of each in the world in [m], shape (3,).
        shown: Pixels of each thing in the camera that truly shows most of it at the end.
    """

    before: CellTruth
    after: CellTruth
    furniture: Mapping[str, FurnitureModel]
    claimed: bool
    estimates: Mapping[str, np.ndarray]
    shown: Mapping[str, int]


def events_of(folder: Path) -> list[dict[str, Any]]:
    """Events of a run's folder, in order; none where there is no record."""
    file = folder / "events.jsonl"
    if not file.is_file():
        return []
    lines = file.read_text(encoding="utf-8").splitlines()
    events = []
    for line in lines:
        try:
            events.append(json.loads(line))
        except ValueError:  # a run that was killed may leave half a line at the end
            continue
    return events


def last_estimates(events: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """The last position estimate of every thing that a run saw, in the world in [m], shape (3,)."""
    return {o["name"]: np.array(o["position"], float) for e in events if e["event"] == "look" for o in e["objects"]}
