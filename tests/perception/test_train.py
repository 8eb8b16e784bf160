"""Training of the bundled models: fair questions, right targets, and a training that goes on after an interruption."""

import json

import numpy as np
import pytest

from perception.errors import FrameError
from perception.evaluation.metrics import ScoredQuestion as Answered
from perception.train.losses import cell_owners, dense_loss, matched_loss, paired_giou
from perception.train.publish import choose_threshold
from perception.train.questions import ask
from perception.train.schedule import rate
from perception.train.shards import Sample, Shards, Thing, Words, cropped
from perception.train.vocabulary import known_words, make_tokenizer

torch = pytest.importorskip("torch")

WORDS = Words(
    nouns=("cube", "block", "apple"),
    colours=("red", "orange", "green"),
    kinds=(("cube",), ("block",), ("apple",)),
    may_be_called=(("block", "cube"), ("block", "cube"), ("apple",)),
    alike_colours=frozenset({frozenset({"red", "orange"})}),
)


def test_questions_are_answered_by_what_they_name_and_never_ask_what_is_a_matter_of_opinion():
    things = (Thing(0, 0, 1, 500, True), Thing(2, 2, 2, 500, True), Thing(2, 0, 3, 20, False))
    seen: dict[str, set[tuple[int, ...]]] = {}
    for seed in range(200):
        for question in ask(things, WORDS, np.random.default_rng(seed)):
            seen.setdefault(question.phrase, set()).add(question.answers)
    assert all(len(answers) == 1 for answers in seen.values())
    assert seen["red cube"] == {(0,)} and seen["cube"] == {(0,)}
    assert seen["green cube"] == {()} and seen["green block"] == {()}
    assert seen["green apple"] == {(1,)}
    # The red cube is nearly orange and might be called a block; the red apple is hardly visible.
    assert not {"orange cube", "block", "red block", "red apple", "orange apple"} & set(seen)


def test_small_things_are_answered_for_on_the_fine_map_and_the_rest_of_a_thing_is_not_judged():
    labels = np.zeros((64, 64), np.uint8)
    labels[8:40, 8:40] = 7
    owner = cell_owners(labels, np.array([[8.0, 8.0, 40.0, 40.0]]), [7], [(8, 8), (4, 4)])
    fine, coarse = owner[:64].reshape(8, 8), owner[64:].reshape(4, 4)
    assert (fine == 0).sum() == 4 and fine[2, 2] == 0 and fine[3, 3] == 0
    assert fine[1, 1] == -2 and fine[6, 6] == -1
    assert (coarse == 0).sum() == 0  # twice the stride: too small for it
    assert (coarse == -2).any()


def test_a_long_thin_thing_is_small():
    labels = np.zeros((64, 64), np.uint8)
    labels[30:34, 2:62] = 1
    owner = cell_owners(labels, np.array([[2.0, 30.0, 62.0, 34.0]]), [1], [(8, 8), (2, 2)])
    assert (owner[:64] == 0).sum() >= 1 and (owner[64:] == 0).sum() == 0


def test_a_thing_between_cells_is_still_answered_for():
    labels = np.zeros((64, 64), np.uint8)
    labels[10:13, 10:13] = 1
    owner = cell_owners(labels, np.array([[10.0, 10.0, 13.0, 13.0]]), [1], [(4, 4)])
    assert (owner == 0).sum() == 1


def test_generalised_iou_is_one_for_equal_boxes_and_negative_far_away():
    a = torch.tensor([[0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 1.0]])
    b = torch.tensor([[0.0, 0.0, 1.0, 1.0], [3.0, 0.0, 4.0, 1.0]])
    assert paired_giou(a, b).tolist() == pytest.approx([1.0, -0.5], abs=1e-4)


def answers(sure: float):
    """Logits and boxes of two queries, the second of which is right; one thing named by tokens 1 and 2 of 4."""
    logits = torch.full((1, 2, 4), -sure)
    logits[0, 1, 1:3] = sure
    boxes = torch.tensor([[[0.2, 0.2, 0.1, 0.1], [0.5, 0.5, 0.2, 0.2]]], requires_grad=True)
    wanted, tokens = [torch.tensor([[0.5, 0.5, 0.2, 0.2]])], [torch.tensor([[0.0, 1.0, 1.0, 0.0]])]
    return logits, boxes, wanted, tokens, torch.ones(1, 4, dtype=torch.bool)


def test_a_right_answer_costs_nothing_and_a_wrong_one_something():
    right, wrong = matched_loss(*answers(8.0)), matched_loss(*answers(-8.0))
    assert right.item() < 1e-3 < 1.0 < wrong.item()


def test_dense_boxes_get_gradients():
    logits, boxes, wanted, tokens, text = answers(0.0)
    dense_loss(logits, boxes, torch.tensor([[0, -1]]), wanted, tokens, text).backward()
    assert boxes.grad is not None
    assert boxes.grad[0, 0].abs().sum() > 0 and boxes.grad[0, 1].abs().sum() == 0


def test_the_plateau_of_the_learning_rate_does_not_depend_on_the_plan():
    assert rate(1000, 5000) == rate(1000, 50_000) == 1.0 > rate(3000, 5000)
    assert rate(0, 5000) < 0.05 and rate(4999, 5000) == pytest.approx(0.02)


def test_a_crop_keeps_labels_and_says_what_is_no_longer_clear():
    labels = np.zeros((60, 80), np.uint8)
    labels[:, :10] = 1
    sample = Sample(np.dstack([labels * 200] * 3), labels, (Thing(0, 0, 1, 600, True),))
    clear = {True: 0, False: 0}
    for seed in range(60):
        cut = cropped(sample, (40, 30), np.random.default_rng(seed))
        assert cut.labels.shape == (30, 40) and cut.colour.shape == (30, 40, 3)
        for thing in cut.things:
            clear[thing.clear] += 1
            if (cut.labels == 1).any():
                assert cut.colour[cut.labels == 1].mean() > 100
    assert clear[True] and clear[False]


def test_words_are_whole_tokens_and_ends_have_the_ids_that_the_architecture_wants():
    tokenizer = make_tokenizer(known_words(("cube",), ("red", "grey")))
    ids = tokenizer("red cube. grey stone.")["input_ids"]
    assert len(ids) == 8 and ids[0] == 101 and ids[-1] == 102 and ids[3] == ids[6] == 1012
    assert 100 not in ids
    assert tokenizer.convert_ids_to_tokens(ids)[1:3] == ["red", "cube"]


def test_the_threshold_parts_right_boxes_from_wrong_ones():
    empty, there = np.zeros((0, 4)), np.array([[0.0, 0.0, 8.0, 8.0]])
    right = [Answered(there, np.array([score]), there) for score in (0.4, 0.6, 0.9)]
    wrong = [Answered(there, np.array([score]), empty) for score in (0.1, 0.2, 0.33)]
    assert choose_threshold([*right, *wrong]) == 0.34
    assert choose_threshold(right) == 0.05


def test_a_file_that_is_no_shard_is_named(tmp_path):
    other = tmp_path / "shard_0000000.npz"
    np.savez(other, meta=np.array(json.dumps({"format": "something"})))
    with pytest.raises(FrameError, match=r"shard_0000000.npz' is not a shard of labelled pictures: its format is"):
        Shards([other])


@pytest.fixture(scope="module")
def shard(tmp_path_factory):
    from sim_check.random_scenes.labelled_pictures import shard_path, write_shard

    path = shard_path(tmp_path_factory.mktemp("shards"), 0)
    write_shard(path, 0, 8)
    return path


@pytest.fixture
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def test_a_detector_that_was_interrupted_goes_on_as_if_it_had_not_been(shard, tmp_path, one_thread):
    from perception.train.detector import DetectorTraining, train_detector

    small = {"batch": 2, "width": 8, "depth": 32, "queries": 8, "save_every": 1, "half": False}

    def train(folder, steps):
        said: list[str] = []
        train_detector(folder, lambda: [shard], DetectorTraining(steps=steps, **small), said.append)
        return torch.load(folder / "detector.pt", weights_only=True)

    # While the rate still rises, it is the same for both plans.
    whole = train(tmp_path / "whole", 3)
    train(tmp_path / "parts", 2)
    (tmp_path / "parts" / "detector.pt").replace(tmp_path / "detector.pt")
    resumed = train(tmp_path, 3)
    assert resumed["step"] == whole["step"] == 3
    for name, weight in whole["model"].items():
        assert torch.allclose(weight.float(), resumed["model"][name].float(), atol=1e-4), name


def test_what_was_trained_loads_through_the_same_code_as_published_weights(shard, tmp_path, one_thread):
    from perception.detection.hf_detector import TransformersDetector
    from perception.frames import CameraIntrinsics, RgbdFrame
    from perception.train.detector import DetectorTraining, train_detector
    from perception.train.segmenter import SegmenterTraining, train_segmenter

    small = DetectorTraining(steps=1, batch=1, width=8, depth=32, queries=8)
    folder = train_detector(tmp_path, lambda: [shard], small, lambda _: None)
    lens = CameraIntrinsics(160, 120, 150.0, 150.0, 79.5, 59.5)
    colour = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    frame = RgbdFrame(colour, np.ones((120, 160), np.float32), lens, np.eye(4), 0.0)
    found = TransformersDetector(str(folder), offline=True, threshold=0.0).detect(frame, ["red cube", "bowl"])
    assert {d.phrase for d in found} == {"red cube", "bowl"}

    said: list[str] = []
    trained = train_segmenter(tmp_path, lambda: [shard], SegmenterTraining(steps=2, batch=2), said.append)
    from perception.detection.crop_segmenter import CropSegmenter, read_crop_settings

    settings = read_crop_settings(trained)
    assert settings is not None and settings.crop_factor == 1.4
    mask = CropSegmenter(trained, settings).segment(frame, np.array([20.0, 20.0, 60.0, 50.0]))
    assert mask.shape == (120, 160) and mask.dtype == bool


def test_a_checkpoint_of_another_network_is_refused(shard, tmp_path, one_thread):
    from perception.train.detector import DetectorTraining, train_detector

    def train(width):
        settings = DetectorTraining(steps=1, batch=1, width=width, depth=32, queries=8)
        train_detector(tmp_path, lambda: [shard], settings, lambda _: None)

    train(8)
    with pytest.raises(FrameError, match=r"detector.pt' does not fit this training .* into another folder"):
        train(16)
