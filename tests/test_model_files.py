"""Where weights are and what they are: found without a network, refused by name."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from perception.errors import ModelUnavailableError
from perception.model_files import DETECTOR, SEGMENTER, find_model
from tests.perception_models import save_tiny_detector, save_tiny_segmenter

# Loads a detector and a segmenter by name, or says why not, on a machine where every socket is refused.
LOOK = """
import socket, sys
asked = []
def refuse(*args, **kwargs):
    asked.append(args)
    raise OSError("no network here")
socket.socket.connect = refuse
socket.getaddrinfo = refuse
import numpy as np
from perception.errors import PerceptionError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.options import PerceptionOptions
from perception.pipeline import perception_from_options
lens = CameraIntrinsics(128, 96, 100.0, 100.0, 63.5, 47.5)
frame = RgbdFrame(np.zeros((96, 128, 3), np.uint8), np.ones((96, 128), np.float32), lens, np.eye(4), 0.0)
for question in sys.argv[1:]:
    mode, detector = question.split(":")
    both = perception_from_options(detector, "maker/sam", PerceptionOptions(0.0, offline=mode == "offline"))
    asked.clear()
    try:
        found = both.detector.detect(frame, ["crate"])
        answer = f"{len(found)} boxes, a mask {both.segmenter.segment(frame, np.array([9, 9, 50, 50])).shape}"
    except PerceptionError as error:
        answer = error
    print(bool(asked), answer)
"""


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


@pytest.fixture(scope="module")
def answers(store):
    """What a process that may reach nothing said to each question, and whether it tried to reach anything."""
    here, absent = ("offline:maker/dino", "online:maker/dino"), ("offline:maker/other", "online:maker/other")
    questions = (*here, *absent, "offline:maker/cut-off")
    environment = {k: v for k, v in os.environ.items() if not k.startswith("HF_")}
    answer = subprocess.run(
        [sys.executable, "-c", LOOK, *questions],
        capture_output=True,
        text=True,
        check=True,
        env=environment | {"HF_HOME": str(store)},
    )
    return dict(zip(questions, answer.stdout.splitlines(), strict=True))


@pytest.mark.parametrize("mode", ["offline", "online"])
def test_weights_that_are_here_are_used_without_asking_the_network(answers, mode):
    assert answers[f"{mode}:maker/dino"] == "False 12 boxes, a mask (96, 128)"


@pytest.mark.parametrize("name", ["other", "cut-off"])
def test_offline_absent_weights_are_named_with_the_command_that_fetches_them(answers, name):
    assert answers[f"offline:maker/{name}"] == (
        f"False the weights of 'maker/{name}' (GroundingDINO or MM-GroundingDINO) are not on this machine; "
        f"fetch them once with: .venv/bin/hf download maker/{name}"
    )


def test_a_hub_that_cannot_be_reached_is_said(answers):
    answer = answers["online:maker/other"]
    assert answer.startswith(
        "True the weights of 'maker/other' (GroundingDINO or MM-GroundingDINO) are not on this machine and cannot be "
        "fetched now ("
    )
    assert answer.endswith("where there is a network, fetch them once with: .venv/bin/hf download maker/other")


def test_a_folder_that_is_not_there_is_named():
    with pytest.raises(ModelUnavailableError, match=r"there is no folder '\./nothing' and it is no hub name \(owner/m"):
        find_model("./nothing", SEGMENTER, offline=False)


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
