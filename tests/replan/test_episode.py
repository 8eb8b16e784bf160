"""A run's record is complete at every moment and readable by anybody."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from control.errors import ConfigError
from control.tasks.failure import FailureCause
from replan.run.episode import Episode, plain


def events(folder):
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


def test_every_event_is_one_json_line_with_its_time(tmp_path):
    episode = Episode.create(tmp_path, "place the red cube!")
    episode.log("look", objects=[{"position": np.array([0.1, 0.2, np.nan])}], share=np.float32(0.5))
    episode.log("failure", cause=FailureCause("blocked_by", "red_cube", "in the way", bodies=("yellow_cube",)))
    lines = events(episode.folder)
    assert [e["event"] for e in lines] == ["look", "failure"]
    assert lines[0]["objects"][0]["position"] == [0.1, 0.2, "nan"]
    assert lines[1]["cause"]["bodies"] == ["yellow_cube"]
    assert lines[0]["time"] <= lines[1]["time"]


def test_a_killed_process_loses_no_event_that_it_logged(tmp_path):
    code = (
        "import os, pathlib, sys\nfrom replan.run.episode import Episode\n"
        "e = Episode(pathlib.Path(sys.argv[1]))\n"
        "for k in range(100): e.log('tick', k=k)\nos.kill(os.getpid(), 9)"
    )
    run = subprocess.run([sys.executable, "-c", code, str(tmp_path / "run")], check=False)
    assert run.returncode == -9
    assert [e["k"] for e in events(tmp_path / "run")] == list(range(100))


def test_two_runs_in_the_same_second_get_folders_of_their_own(tmp_path):
    folders = {Episode.create(tmp_path, "same goal").folder for _ in range(3)}
    assert len(folders) == 3


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(ConfigError, match=r"cannot write the run's folder .* choose --runs-dir"):
        Episode.create(tmp_path, "goal")


def test_a_file_in_the_place_of_the_runs_folder_is_named(tmp_path):
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(ConfigError, match=r"cannot write the run's folder .* choose --runs-dir"):
        Episode.create(tmp_path / "runs", "goal")


def test_large_arrays_are_logged_as_their_shape():
    assert plain(np.zeros((480, 640), np.float32)) == "array(480, 640) of float32"
