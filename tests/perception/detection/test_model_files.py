"""Where weights are and what they are: found without a network, refused by name."""

import json
import re
import shutil
import socket

import huggingface_hub
import numpy as np
import pytest

from perception.detection import hf_detector, hf_segmenter
from perception.detection.model_files import DETECTOR, SEGMENTER, find_model
from perception.errors import ModelUnavailableError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.options import PerceptionOptions
from perception.pipeline import perception_from_options
from tests.support.models.perception_models import save_tiny_detector, save_tiny_segmenter


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A store as the hub's client keeps it, with a detector, a segmenter and a download that was cut off."""
    home = tmp_path_factory.mktemp("hub_home")
    for name, save in (("dino", save_tiny_detector), ("sam", save_tiny_segmenter), ("cut-off", save_tiny_detector)):
        model = home / "hub" / f"models--maker--{name}"
        (model / "refs").mkdir(parents=True)
        (model / "refs" / "main").write_text("0123abcd")
        save(model / "snapshots" / "0123abcd")
    (model / "snapshots" / "0123abcd" / "model.safetensors").unlink()
    return home


@pytest.fixture
def asked(store, monkeypatch):
    """The store in use, and a network that refuses everything; a list of what was tried to reach."""
    tried = []

    def refuse(*args, **kwargs):
        tried.append(args)
        raise OSError("no network here")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_CACHE", str(store / "hub"))
    return tried


@pytest.mark.parametrize("offline", [True, False])
def test_weights_that_are_here_are_used_without_asking_the_network(asked, offline):
    lens = CameraIntrinsics(128, 96, 100.0, 100.0, 63.5, 47.5)
    frame = RgbdFrame(np.zeros((96, 128, 3), np.uint8), np.ones((96, 128), np.float32), lens, np.eye(4), 0.0)
    hf_detector._load_detector.cache_clear()
    hf_segmenter.load_segmenter.cache_clear()
    both = perception_from_options("maker/dino", "maker/sam", PerceptionOptions(threshold=0.0, offline=offline))
    assert both.detector.detect(frame, ["crate"])
    assert both.segmenter.segment(frame, np.array([9.0, 9.0, 50.0, 50.0])).shape == (96, 128)
    assert asked == []


@pytest.mark.parametrize("name", ["other", "cut-off"])
def test_offline_absent_weights_are_named_with_the_command_that_fetches_them(asked, name):
    with pytest.raises(ModelUnavailableError) as caught:
        find_model(f"maker/{name}", DETECTOR, offline=True)
    assert str(caught.value) == (
        f"the weights of 'maker/{name}' (GroundingDINO or MM-GroundingDINO) are not on this machine; "
        f"fetch them once with: .venv/bin/hf download maker/{name}"
    )
    assert asked == []


def test_a_hub_that_cannot_be_reached_is_said(asked):
    with pytest.raises(ModelUnavailableError) as caught:
        find_model("maker/other", DETECTOR, offline=False)
    assert re.fullmatch(
        r"the weights of 'maker/other' \(GroundingDINO or MM-GroundingDINO\) are not on this machine and cannot be "
        r"fetched now \(.+\); where there is a network, fetch them once with: \.venv/bin/hf download maker/other",
        str(caught.value),
    )
    assert asked, "it was tried"


def test_a_folder_that_is_not_there_is_named():
    with pytest.raises(ModelUnavailableError, match=r"there is no folder '\./nothing' and it is no hub name \(owner/m"):
        find_model("./nothing", SEGMENTER, offline=False)


def test_options_name_weights_that_are_not_there_before_any_look():
    with pytest.raises(ModelUnavailableError, match=r"there is no folder '\./nothing'"):
        perception_from_options(detector="./nothing")
    with pytest.raises(ModelUnavailableError, match=r"the weights of 'maker/no-such' .* are not on this machine"):
        perception_from_options(segmenter="maker/no-such", options=PerceptionOptions(offline=True))


@pytest.mark.parametrize(
    ("kind", "role", "message"),
    [
        (
            "bert",
            DETECTOR,
            "holds a 'bert' model, but a detector must be GroundingDINO or MM-GroundingDINO; choose ano",
        ),
        (
            "owlv2",
            DETECTOR,
            "holds a 'owlv2' model, but a detector must be GroundingDINO or MM-GroundingDINO; choose a",
        ),
        ("sam", DETECTOR, "holds a 'sam' model, but a detector must be .*; pass it as --segmenter"),
        ("mm-grounding-dino", SEGMENTER, "but a segmenter must be SAM or SAM 2; pass it as --detector"),
    ],
)
def test_another_architecture_is_named_with_what_is_needed(tmp_path, kind, role, message):
    (tmp_path / "config.json").write_text(json.dumps({"model_type": kind}))
    with pytest.raises(ModelUnavailableError, match=message):
        find_model(str(tmp_path), role, offline=True)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (None, "does not hold a detector: it has no config.json; a detector must be GroundingDINO or"),
        ("{", "does not hold a detector: its config.json names no model_type"),
        ("[]", "does not hold a detector: its config.json names no model_type"),
        ('{"model_type": "grounding-dino"}', "has a config.json but no weights; it needs model.safetensors or"),
    ],
)
def test_an_incomplete_folder_is_refused(tmp_path, config, message):
    if config is not None:
        (tmp_path / "config.json").write_text(config)
    with pytest.raises(ModelUnavailableError, match=message):
        find_model(str(tmp_path), DETECTOR, offline=True)


def test_a_folder_may_be_written_from_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    folder = tmp_path / "weights"
    folder.mkdir()
    (folder / "config.json").write_text('{"model_type": "sam2_video"}')
    (folder / "model.safetensors").touch()
    assert find_model("~/weights", SEGMENTER, offline=True) == folder
    shutil.rmtree(folder)
