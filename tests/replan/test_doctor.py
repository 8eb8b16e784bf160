"""`replan doctor` on weights: where they are, how large, what is known of them, and what fetches the others."""

import json
import os
import subprocess
import sys

import pytest

from perception.detection import bundled
from replan.doctor.machine import Finding, Findings, render
from replan.doctor.reasoners import Backend, examine_reasoners
from replan.doctor.weights import PUBLISHED, examine_weights
from tests.support.models.language_server import KEY, MODEL, language_server, unused_address
from tests.support.models.perception_models import save_tiny_detector, save_tiny_segmenter

CARD = {"name": "tiny SAM", "made": "2026-11-25", "trained_on": "nothing", "figures": {"mean_IoU": 0.875}}


def named(found, name):
    return next(w for w in found if w.name == name)


def test_bundled_weights_are_shown_with_place_size_and_figures(tmp_path, monkeypatch):
    monkeypatch.setattr(bundled, "SEGMENTER_FOLDER", tmp_path)
    save_tiny_segmenter(tmp_path)
    (tmp_path / "card.json").write_text(json.dumps(CARD))
    weights = named(examine_weights("default", "default"), "bundled segmenter")
    size = sum(f.stat().st_size for f in tmp_path.iterdir()) / 1e6
    assert weights.here
    assert weights.detail == f"tiny SAM of 2026-11-25, {size:.0f} MB in {tmp_path}; mean_IoU 0.875"


def test_a_package_without_bundled_weights_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(bundled, "DETECTOR_FOLDER", tmp_path / "detector")
    weights = named(examine_weights("default", "default"), "bundled detector")
    assert not weights.here and weights.detail.startswith("this package has no bundled detector (")


def test_a_card_without_weights_is_not_taken_for_weights(tmp_path, monkeypatch):
    monkeypatch.setattr(bundled, "SEGMENTER_FOLDER", tmp_path)
    (tmp_path / "card.json").write_text(json.dumps(CARD))
    weights = named(examine_weights("default", "default"), "bundled segmenter")
    assert not weights.here and "does not hold a segmenter: it has no config.json" in weights.detail


def test_a_folder_that_is_asked_about_is_examined(tmp_path):
    save_tiny_detector(tmp_path / "mine", mm=True)
    found = examine_weights(str(tmp_path / "mine"), str(tmp_path / "nothing"))
    mine, nothing = named(found, str(tmp_path / "mine")), named(found, str(tmp_path / "nothing"))
    assert mine.here and mine.detail.startswith("detector, ") and mine.detail.endswith(f"MB in {tmp_path / 'mine'}")
    assert not nothing.here and "there is no folder" in nothing.detail
    swapped = named(examine_weights("default", str(tmp_path / "mine")), str(tmp_path / "mine"))
    assert not swapped.here and "a segmenter must be SAM or SAM 2; pass it as --detector" in swapped.detail


@pytest.mark.parametrize("variable", ["HF_HOME", "HF_HUB_CACHE"])
def test_published_weights_are_found_where_the_hubs_client_keeps_them(tmp_path, variable):
    here = "openmmlab-community/mm_grounding_dino_tiny_o365v1_goldg_v3det"
    store = tmp_path / "hub" if variable == "HF_HOME" else tmp_path
    model = store / f"models--{here.replace('/', '--')}"
    (model / "refs").mkdir(parents=True)
    (model / "refs" / "main").write_text("0123abcd")
    save_tiny_detector(model / "snapshots" / "0123abcd", mm=True)
    code = (
        "import json, sys\nfrom replan.doctor.weights import examine_weights\n"
        "found = examine_weights('default', 'default')\n"
        "print(json.dumps([[w.name, w.here, w.detail, w.command] for w in found]))\n"
        "print([n for n in ('torch', 'transformers') if n in sys.modules])"
    )
    environment = {k: v for k, v in os.environ.items() if not k.startswith("HF_")}
    answer = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=environment | {variable: str(tmp_path)},
    )
    found, loaded = answer.stdout.splitlines()
    rows = {name: (ok, detail, command) for name, ok, detail, command in json.loads(found)}
    assert rows[here][0] and rows[here][1].endswith(f"MB in {model / 'snapshots' / '0123abcd'}")
    for name, role in PUBLISHED.items():
        if name != here:
            assert rows[name] == (False, f"{role.name}, not on this machine", f".venv/bin/hf download {name}")
    assert loaded == "[]", "looking at weights loads no network"


def test_commands_stand_on_lines_of_their_own():
    name = "openmmlab-community/mm_grounding_dino_tiny_o365v1_goldg_v3det"
    command = f".venv/bin/hf download {name}"
    text = render(Findings((Finding("weights", name, False, "detector, not on this machine", command=command),)))
    assert f"\n  {command}\n" in text


def test_the_command_that_fetches_exists():
    from pathlib import Path

    client = Path(sys.executable).with_name("hf")
    shown = subprocess.run([client, "download", "--help"], capture_output=True, text=True, check=True)
    assert "REPO_ID" in shown.stdout


def test_language_backends_are_listed_and_no_server_is_asked_unless_it_is_named():
    found = {b.name: b for b in examine_reasoners(None)}
    assert list(found) == ["builtin", "openai", "transformers", "cassette"] and all(b.here for b in found.values())
    assert "no server asked; name one with --reasoner-url" in found["openai"].detail
    assert "torch " in found["transformers"].detail


def test_a_language_server_that_is_named_is_asked(monkeypatch):
    def openai(*server):
        return examine_reasoners(server)[1]

    with language_server() as server:
        assert openai(server.url, None, "KEY") == Backend("openai", True, f"{server.url} answers; models: {MODEL}")
        assert openai(server.url, MODEL, "KEY").detail == f"{MODEL} at {server.url} answers"
        assert "has no model 'other'" in openai(server.url, "other", "KEY").detail
        monkeypatch.setenv("KEY", "sk-wrong")
        server.key = KEY
        refused = openai(server.url, MODEL, "KEY")
        assert not refused.here and "refused the key in KEY (401)" in refused.detail
    gone = openai(unused_address(), None, "KEY")
    assert not gone.here and "no language server answers at" in gone.detail
    assert "is no address of a server" in openai("localhost", None, "KEY").detail
