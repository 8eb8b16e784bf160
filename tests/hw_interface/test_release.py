"""A release speaks one version of the wire's protocol, and two sides that differ name both."""

import re
import subprocess
import sys
import tomllib

import msgpack
import pytest

from hw_interface.errors import MessageError
from hw_interface.messages.protocol import RELEASES, other_protocol
from hw_interface.messages.robot import StopRequest
from hw_interface.messages.wire import PROTOCOL_VERSION, decode
from replan_base import __version__
from replan_base.packages import ROOT


def test_this_release_speaks_the_newest_protocol_of_the_table():
    assert RELEASES[PROTOCOL_VERSION] == __version__, "a new protocol needs a line in hw_interface/messages/protocol.py"
    assert max(RELEASES) == PROTOCOL_VERSION


def test_protocols_follow_each_other_as_releases_do():
    assert list(RELEASES) == list(range(1, PROTOCOL_VERSION + 1))
    numbers = [tuple(int(n) for n in release.split(".")) for release in RELEASES.values()]
    assert numbers == sorted(numbers)


def test_a_message_of_an_older_release_names_both_versions():
    older = msgpack.packb({"protocol": 3, "type": "stop_request", "crc": 0, "body": {}})
    assert older is not None
    said = (
        r"version 3 is not understood \(replan 0\.1\.0 speaks it\); this side, replan "
        rf"{re.escape(__version__)}, speaks version {PROTOCOL_VERSION}: install the same release on both sides"
    )
    with pytest.raises(MessageError, match=said):
        decode(older, StopRequest)


def test_a_protocol_of_the_future_is_named_by_its_number_alone():
    assert other_protocol(99, 4).startswith("version 99 is not understood; this side, replan ")
    assert other_protocol(True, 4).startswith("version True is not understood; this side")


def test_the_version_stands_in_one_place_and_the_command_tells_it():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert "version" not in project["project"]
    assert project["tool"]["hatch"]["version"]["path"] == "replan_base/__init__.py"
    said = subprocess.check_output([sys.executable, "-m", "replan.main", "--version"], text=True, cwd=ROOT)
    assert said == f"replan {__version__}\n"


def test_the_change_log_has_this_version_with_a_date_and_those_before_below_it():
    headings = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    dated = [h for h in headings if h != "[Unreleased]"]
    assert all(re.fullmatch(r"\[\d+\.\d+\.\d+\] - \d{4}-\d{2}-\d{2}", heading) for heading in dated), headings
    assert dated[0].startswith(f"[{__version__}]")
    assert [h.split(" - ")[1] for h in dated] == sorted((h.split(" - ")[1] for h in dated), reverse=True)
