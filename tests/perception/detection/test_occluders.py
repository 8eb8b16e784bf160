"""What stands before a thing, inside its box, is not the thing: a bottle before a cracker box in a real frame."""

from pathlib import Path

import numpy as np
import pytest

from perception.detection.given import GivenBoxes
from perception.estimates import SceneEstimate
from perception.pipeline import Perception, default_perception
from perception.recordings.opening import open_recording

FOLDER = Path(__file__).parents[2] / "data" / "occluded_box"  # of the PoseCNN demonstration, licence beside it
BOXES = {"cracker_box": [97, 25, 279, 268], "bleach_cleanser": [117, 50, 236, 322]}  # in [px], drawn by hand
CRACKER_BOX = (0.060, 0.158, 0.210)  # in [m]
ON_THE_BOTTLE = (180, 160)  # u and v in [px]


def look(*names: str) -> SceneEstimate:
    frame = next(iter(open_recording(FOLDER)))
    detector = GivenBoxes({name: np.array([BOXES[name]], float) for name in names})
    return Perception(detector, default_perception().segmenter).perceive([frame], names)


@pytest.mark.parametrize("names", [("cracker_box",), ("cracker_box", "bleach_cleanser")], ids=["alone", "both"])
def test_a_bottle_before_a_cracker_box_is_not_taken_into_it(names):
    found = look(*names).get("cracker_box")
    assert found is not None
    u, v = ON_THE_BOTTLE
    assert not found.evidence[0].mask[v, u]
    assert np.sort(found.extents) == pytest.approx(CRACKER_BOX, abs=0.010)
    # The bottle hides most of its foot, so that its height is the least sure of its sizes.
    assert found.extents_std is not None and found.extents_std[2] > 0.004
    assert abs(found.extents[2] - CRACKER_BOX[2]) < 2.0 * found.extents_std[2]


def test_the_bottle_itself_stays_whole():
    bottle = look("cracker_box", "bleach_cleanser").get("bleach_cleanser")
    assert bottle is not None
    u, v = ON_THE_BOTTLE
    assert bottle.evidence[0].mask[v, u]
    assert bottle.extents[2] == pytest.approx(0.25, abs=0.015)
