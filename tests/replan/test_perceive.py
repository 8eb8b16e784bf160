"""`replan perceive` on recordings: what it writes, what it skips, how it stops, and its page."""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from control.errors import ConfigError
from perception.errors import FrameError
from perception.frames import RgbdFrame
from perception.ground_truth import FrameTruth, TrueObject
from perception.recordings.opening import Recording, Skipped, TruthOfFrame, save_npz
from perception.scene_file import LookRecord, PerceptionResult, read_perception_result
from replan.errors import DONE, NOT_REACHED
from replan.perceive import frame_stream
from replan.perceive.options import PerceiveOptions, ReadingOptions
from replan.perceive.page import PerceivePage
from replan.perceive.recording import perceive_recording
from replan.perceive.report import as_json, as_text
from replan.perceive.result_file import ResultFile
from replan.progress import Progress
from tests.support.scenes.perception_scenes import RED, YELLOW, cube, render

SMALL = (320, 240)


def at(frame: RgbdFrame, stamp: float, camera: str = "static") -> RgbdFrame:
    return replace(frame, stamp=stamp, camera=camera)


def blind(frame: RgbdFrame) -> RgbdFrame:
    return replace(frame, depth=np.full(frame.depth.shape, np.nan, np.float32))


@pytest.fixture(scope="module")
def shots() -> list[RgbdFrame]:
    """A red and a yellow cube; from the fourth frame on the red one stands elsewhere."""
    before = [cube(RED, 0.45, -0.10), cube(YELLOW, 0.55, 0.12)]
    after = [cube(RED, 0.40, 0.05), cube(YELLOW, 0.55, 0.12)]
    return [at(render(before if k < 3 else after, size=SMALL, seed=k), float(k)) for k in range(5)]


def run(tmp_path: Path, frames: Sequence[RgbdFrame], names=("red_cube", "yellow_cube"), choice=None, **how):
    save_npz(tmp_path / "in.npz", frames)
    said: list[str] = []
    how.setdefault("page", False)
    options = PerceiveOptions(names=names, out=tmp_path / "out", **how)
    report = perceive_recording(tmp_path / "in.npz", options, ReadingOptions(**(choice or {})), said.append)
    return report, read(tmp_path), said


def read(tmp_path: Path) -> PerceptionResult:
    path = tmp_path / "out" / "objects.json"
    return read_perception_result(path, json.loads(path.read_text()))


def test_things_keep_their_names_and_settle_until_they_are_moved(tmp_path, shots):
    report, result, _ = run(tmp_path, shots)
    assert report.exit_code == DONE
    assert [f.key for f in result.frames] == ["0", "1", "2", "3", "4"]
    red = [next(o for o in f.objects if o.name == "red_cube").track for f in result.frames]
    assert [t.id for t in red if t] == ["red_cube"] * 5
    assert [(t.frames, t.moves) for t in red if t] == [(1, 0), (2, 0), (3, 0), (1, 1), (2, 1)]
    yellow = [next(o for o in f.objects if o.name == "yellow_cube").track for f in result.frames]
    assert yellow[-1] is not None and yellow[-1].frames == 5
    assert yellow[-1].world_T_object[1][3] == pytest.approx(0.12, abs=0.004)
    assert all(f.seconds["pose"] > 0 for f in result.frames)


def test_every_frame_has_its_picture_and_few_frames_their_clouds(tmp_path, shots):
    report, result, _ = run(tmp_path, shots[:2])
    for record in result.frames:
        assert record.picture is not None and record.cloud is not None
        assert cv2.imread(record.picture, cv2.IMREAD_UNCHANGED).shape == (240, 320, 3)  # type: ignore[union-attr]
        assert Path(record.cloud).read_bytes().startswith(b"ply")
    without, result, _ = run(tmp_path, shots[:2], clouds=False)
    assert [f.cloud for f in result.frames] == [None, None]
    assert "point clouds" not in as_text(without)
    assert "frame 1 at 1.000 s of camera 'static'" in as_text(report)


def test_of_many_frames_no_clouds_are_written_and_it_is_said(tmp_path, shots):
    report, result, _ = run(tmp_path, [at(shots[0], float(k)) for k in range(21)], names=("red_cube",))
    assert not list((tmp_path / "out").glob("*.ply"))
    text = as_text(report)
    assert "no point clouds were written, as there are more than 20 frames; --clouds writes them" in text
    assert "red_cube         found in 21" in text
    assert len(result.frames) == 21


def test_frames_that_cannot_be_used_are_skipped_and_named(tmp_path, shots):
    report, result, _ = run(tmp_path, [shots[0], blind(shots[1]), shots[2]])
    assert report.exit_code == DONE
    assert [f.key for f in result.frames] == ["0", "2"]
    (skipped,) = result.skipped
    assert skipped.where == "frame 1"
    assert "has no valid depth at all" in skipped.reason
    assert "1 skipped:\n  frame 1: the frame of camera 'static'" in as_text(report)
    assert as_json(report)["skipped"][0]["where"] == "frame 1"


def test_a_recording_without_a_single_good_frame_is_an_error_that_names_the_first(tmp_path, shots):
    with pytest.raises(FrameError, match=r"no frame of 'in.npz' can be used \(2 skipped\); first frame 0: .* no valid"):
        run(tmp_path, [blind(shots[0]), blind(shots[1])])
    assert len(read(tmp_path).skipped) == 2


def test_nothing_found_in_any_frame_is_no_success(tmp_path, shots):
    report, result, _ = run(tmp_path, shots[:1], names=("green_cube",))
    assert report.exit_code == NOT_REACHED
    assert result.frames[0].unseen[0].name == "green_cube"


def test_only_the_frames_that_are_asked_for_are_looked_at(tmp_path, shots):
    frames = [at(shots[0], float(k), "left" if k % 2 else "right") for k in range(10)]
    _, result, _ = run(tmp_path, frames, choice={"camera": "left", "every": 2, "frames": 2})
    assert [(f.key, f.camera) for f in result.frames] == [("1", "left"), ("5", "left")]
    # Without --camera every second frame of each: both cameras are seen.
    _, result, _ = run(tmp_path, frames, choice={"every": 2, "frames": 4})
    assert [(f.key, f.camera) for f in result.frames] == [("0", "right"), ("1", "left"), ("4", "right"), ("5", "left")]


def test_a_camera_that_was_not_recorded_is_refused_with_those_that_were(tmp_path, shots):
    with pytest.raises(FrameError, match="has no frame of camera 'wrist'; its cameras are static"):
        run(tmp_path, shots[:2], choice={"camera": "wrist"})


def test_stopping_keeps_what_was_done(tmp_path, shots, monkeypatch):
    real, count = ResultFile.add, iter(range(10))

    def add(self, record):
        real(self, record)
        if next(count) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(ResultFile, "add", add)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, shots, page=True)
    result = read(tmp_path)
    assert (len(result.frames), result.finished) == (2, False)
    assert "stopped before the end" in (tmp_path / "out" / "report.html").read_text()


def test_the_file_is_whole_after_every_record(tmp_path):
    record = LookRecord(camera="static", stamp=1.0, objects=())
    path = tmp_path / "objects.json"
    with ResultFile(path, "nobody", tmp_path) as file:
        for k in range(4):
            assert len(json.loads(path.read_text())["frames"]) == k
            file.add(record)
            file.skip(f"frame {k}", "torn")
            content = json.loads(path.read_text())
            assert (len(content["skipped"]), content["finished"]) == (k + 1, False)
        file.finish(True, {"ap50": 1.0})
        file.finish(True, None)  # shorter than what stands there
    assert read_perception_result(path, json.loads(path.read_text())).finished


def test_boxes_by_hand_need_no_names_and_no_detector(tmp_path, shots):
    boxes = tmp_path / "boxes.yaml"
    boxes.write_text('{boxes: {toy: [100, 60, 200, 160]}, frames: {"1": {other: [10, 10, 30, 30]}}}')
    report, result, _ = run(tmp_path, shots[:2], names=(), boxes=boxes)
    assert report.source == "boxes given by hand + GrabCut-and-depth (OpenCV)"
    assert {u.name: u.reason for u in result.frames[0].unseen}["other"] == "no box was given for this frame"
    boxes.write_text('frames: {"7": {toy: [100, 60, 200, 160]}}')
    with pytest.raises(FrameError, match="names the frame '7', which the recording does not have; its frames are 0, 1"):
        run(tmp_path, shots[:2], names=(), boxes=boxes)


def test_masks_by_hand_lead_to_poses(tmp_path, shots):
    masks = tmp_path / "masks"
    masks.mkdir()
    colour = shots[0].colour.astype(int)
    red = (colour[..., 0] - colour[..., 1] > 60) & (colour[..., 0] - colour[..., 2] > 60)
    cv2.imwrite(str(masks / "0_brick.png"), 255 * red.astype(np.uint8))
    report, result, _ = run(tmp_path, shots[:2], names=(), masks=masks)
    assert report.source == "masks given by hand + masks given by hand"
    (brick,) = result.frames[0].objects
    assert brick.world_T_object[0][3] == pytest.approx(0.45, abs=0.01)
    assert result.frames[1].unseen[0].reason == "no mask was given for this frame"


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ({"names": ()}, "no name given to look for; say --names red_cube crate"),
        ({"names": ("a",), "boxes": Path("b"), "masks": Path("m")}, "--boxes and --masks exclude each other"),
        ({"names": ("a",), "instances": 0}, "--instances 0 is not valid; it must be at least 1"),
    ],
)
def test_options_that_make_no_sense_are_refused_by_name(how, reason, tmp_path):
    with pytest.raises(ConfigError, match=re.escape(reason)):
        PerceiveOptions(out=tmp_path, **how)


def test_reading_no_frames_makes_no_sense_either():
    with pytest.raises(ConfigError, match="--every 0 is not valid; it must be at least 1"):
        ReadingOptions(every=0)


class Told(Recording):
    """Frames that come with what truly was in them, one of them torn."""

    def __init__(self, pairs: Sequence[TruthOfFrame]) -> None:
        super().__init__("told", len(pairs) + 1, ("the world is the robot's base",), True)
        self._pairs = pairs

    def _items(self, with_truth: bool) -> Iterator[TruthOfFrame | Skipped]:
        yield Skipped("picture 0", "torn")
        yield from self._pairs


def truth(red: tuple[float, float]) -> FrameTruth:
    pose = np.eye(4)
    pose[:3, 3] = (*red, 0.03)
    pose[:2, :2] = [[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]]
    return FrameTruth((TrueObject("red_cube", pose, np.full(3, 0.06), "box"),), ("green_cube",))


def test_errors_are_measured_where_the_recording_knows_the_truth(tmp_path, shots, monkeypatch):
    told = Told([TruthOfFrame(shots[0], truth((0.45, -0.10))), TruthOfFrame(shots[4], truth((0.40, 0.05)))])
    monkeypatch.setattr(frame_stream, "open_recording", lambda *_, **__: told)
    how = PerceiveOptions(names=("red_cube", "yellow_cube", "green_cube"), out=tmp_path / "out")
    report = perceive_recording(tmp_path / "told.bag", how)
    result = read(tmp_path)
    assert [f.key for f in result.frames] == ["1", "2"]
    assert result.metrics is not None
    assert (result.metrics["n_frames"], result.metrics["n_objects"]) == (2, 2)  # nobody knows about the yellow one
    assert result.metrics["absent_false_positive_rate"] == 0.0
    assert result.metrics["position_mm"]["median"] < 8.0
    assert "position error [mm]" in as_text(report)
    html = (tmp_path / "out" / "report.html").read_text()
    assert "Against the recording's truth" in html
    assert "the world is the robot&#39;s base" in html


def test_the_page_holds_everything_itself(tmp_path, shots):
    report, _, _ = run(tmp_path, [shots[0], blind(shots[1]), shots[2]], names=("red_cube", "green_cube"), page=True)
    assert report.page is not None
    html = report.page.read_text()
    assert html.count("data:image/jpeg;base64,") == 4  # an overlay and a depth picture of both good frames
    assert not re.search(r'(?:src|href)="(?!data:|#)', html)
    for text in (
        "1 thing",
        "green_cube",
        "no box above the threshold",
        "has no valid depth at all",
        "Things over time",
    ):
        assert text in html
    assert "All 2 frames." in html


def test_of_a_long_recording_the_page_shows_evenly_spaced_frames_and_says_so(tmp_path, shots):
    from perception.pipeline import default_perception
    from perception.tracking.tracker import Tracker
    from replan.perceive.frame_stream import KeyedFrame

    scene = default_perception().perceive([shots[0]], ["red_cube"])
    tracks = Tracker().update(scene.objects)
    page = PerceivePage(most=4)
    for k in range(27):
        page.add(KeyedFrame(str(k), shots[0], None), scene, tracks, shots[0].colour, tmp_path / f"{k}.png")
    shown = [int(card.picture_file.removesuffix(".png")) for card in page.cards]
    assert (page.stride, shown) == (8, [0, 8, 16, 24])


def test_progress_says_which_of_how_many_and_what_is_left():
    said: list[str] = []
    with Progress("frame", 3, said.append) as progress:
        for note in ("a", "b", "c"):
            progress.step(note)
    assert re.fullmatch(r"frame 1 of 3: a \(\d+ s left\)", said[0])
    assert said[-1] == "frame 3 of 3: c"
    said.clear()
    with Progress("frame", None, said.append) as progress:
        progress.step("a")
    assert said == ["frame 1: a"]


def test_what_nobody_named_is_added_where_it_is_asked_for(tmp_path, shots):
    run(tmp_path, shots[:1], names=("red_cube",), unnamed=True)
    (look,) = read(tmp_path).frames
    named = {o.name: o.named for o in look.objects}
    assert named == {"red_cube": True, "unnamed_1": False}
    run(tmp_path, shots[:1], names=("red_cube",))
    assert [o.name for o in read(tmp_path).frames[0].objects] == ["red_cube"]
