"""The detector of the how-to page works as the page shows it."""

import re
from pathlib import Path

import pytest

from perception.interfaces import Detector
from tests.support.scenes.perception_scenes import BLUE, RED, cube, render

PAGE = Path(__file__).resolve().parents[3] / "docs" / "how-to" / "add-a-detector.md"


def test_the_detector_of_the_page_finds_the_tallest_thing_and_is_named_as_the_source():
    frame = render([cube(RED, 0.45, 0.12, half=0.025), cube(BLUE, 0.5, -0.1, half=0.04)])
    names: dict = {"frame": frame}
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)  # the page's own text, checked in with this test
    own: Detector = names["TallestThing"]()
    boxes = own.detect(frame, ["cup", "lid"])
    assert [b.phrase for b in boxes] == ["cup", "lid", "cup", "lid"] and boxes[0].score > boxes[2].score
    (cup,) = names["scene"].objects
    assert cup.name == "cup" and cup.position == pytest.approx((0.5, -0.1, 0.04), abs=0.012)
    assert names["scene"].source.startswith("tallest thing (depth alone), not a learned model + ")
