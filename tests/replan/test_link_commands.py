"""The commands around links between machines, as a person types them."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.typed_commands import one_line_reason, replan


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the keys of all roles, made by the command."""
    folder = tmp_path_factory.mktemp("commands")
    done = replan("security", "init", "keys", "--host", "127.0.0.1", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    roles = ("robot", "router", "camera", "operator", "viewer", "ros2")
    assert json.loads(done.stdout)["links"] == [f"keys/{role}.yaml" for role in roles]
    return folder / "keys"


def test_keys_are_made_once_and_examined(keys: Path):
    again = replan("security", "init", "keys", "--host", "127.0.0.1", cwd=keys.parent)
    assert again.returncode == 2 and "never overwritten" in one_line_reason(again)
    shown = replan("security", "show", "keys/router.yaml", cwd=keys.parent)
    assert shown.returncode == 0
    assert "router.pem: 'router' at 127.0.0.1, good until" in shown.stdout
    (keys / "camera-key.pem").chmod(0o640)
    open_to_others = replan("security", "show", "keys/camera.yaml", cwd=keys.parent)
    assert open_to_others.returncode == 1 and "TROUBLE: its key" in open_to_others.stdout


def test_a_router_says_where_it_listens_and_serves_until_it_is_told_to_end(keys: Path):
    command = [sys.executable, "-m", "replan.main", "router", "--endpoint", "tls/127.0.0.1:0", "--json"]
    with subprocess.Popen([*command, "--link", str(keys / "router.yaml")], stdout=subprocess.PIPE, text=True) as router:
        try:
            assert router.stdout is not None
            endpoint = json.loads(router.stdout.readline())["endpoint"]
            # It is there and accepts the certificate, but no robot has joined.
            asked = replan("robot", "speed", "0.5", "--robot", endpoint, "--link", "viewer.yaml", cwd=keys)
            assert asked.returncode == 1 and "did not answer 'cell/info'" in one_line_reason(asked)
            os.kill(router.pid, signal.SIGINT)
            assert router.wait(5) == 0
        finally:
            router.kill()


def test_a_link_file_is_never_left_aside_silently(keys: Path):
    for arguments in (("run", "find the crate"), ("record", "out.mcap")):
        alone = replan(*arguments, "--link", "viewer.yaml", cwd=keys)
        assert alone.returncode == 2 and "give --robot tls/HOST:PORT as well" in one_line_reason(alone)
    plain = replan("robot", "acknowledge", "--link", "viewer.yaml", cwd=keys)
    assert plain.returncode == 2 and "is plain TCP, but a link file was given" in one_line_reason(plain)
    remote = replan("robot", "acknowledge", "--robot", "tls/robot-pc:7447", cwd=keys)
    assert remote.returncode == 2 and "needs certificates" in one_line_reason(remote)
