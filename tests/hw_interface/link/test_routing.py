"""Clients of one robot process hear each other through it, and processes that die or freeze are noticed."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh

from hw_interface.link import transport
from tests.support.load.freezing import freeze, wake
from tests.support.robot_side.hw_link_peer import NAME
from tests.support.waiting import until

CAMERAS = "cell/camera/*"


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    """Where a session listens."""
    session, where = transport.open_robot_session("tcp/127.0.0.1:0")
    yield where
    session.close()


@contextmanager
def peer(endpoint: str, busy: int = 0, lease_ms: int = transport.LEASE_MS) -> Iterator["subprocess.Popen[str]"]:
    """Another client, in a process of its own."""
    command = [sys.executable, "-m", "tests.support.robot_side.hw_link_peer", endpoint, str(busy), str(lease_ms)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


class Watch:
    """A client that notes when cameras come and go, and what is published."""

    def __init__(self, endpoint: str) -> None:
        self.session = transport.open_client_session(endpoint)
        self.seen: list[tuple[bool, float]] = []
        self.news = 0
        self._held = (
            self.session.liveliness().declare_subscriber(CAMERAS, self._on_camera, history=True),
            self.session.declare_subscriber("cell/news", self._on_news),
        )

    def _on_camera(self, sample: zenoh.Sample) -> None:
        self.seen.append((sample.kind == zenoh.SampleKind.PUT, time.monotonic()))

    def _on_news(self, _: zenoh.Sample) -> None:
        self.news += 1

    def here(self) -> bool:
        """Whether the camera is there as far as this client knows."""
        return bool(self.seen) and self.seen[-1][0]


@pytest.fixture
def watch(endpoint: str) -> Iterator[Watch]:
    client = Watch(endpoint)
    yield client
    client.session.close()


def test_what_one_client_offers_reaches_the_others_through_the_robot_process(endpoint: str, watch: Watch):
    with peer(endpoint):
        assert until(watch.here), "its liveliness token"
        (reply,) = list(watch.session.get(f"{transport.FRAME_KEY}/{NAME}", timeout=2.0))
        assert reply.ok is not None and reply.ok.payload.to_bytes() == b"a picture"
        assert until(lambda: watch.news > 3), "what it publishes"
        # One that connects later finds it too.
        later = Watch(endpoint)
        assert until(later.here)
        later.session.close()


def test_a_client_that_is_killed_is_noticed_at_once(endpoint: str, watch: Watch):
    with peer(endpoint) as process:
        assert until(watch.here)
        struck = time.monotonic()
        os.kill(process.pid, signal.SIGKILL)
        assert until(lambda: not watch.here())
        # 8 ms by its closed socket; the rest is room for a busy machine, and a tenth of the lease.
        assert watch.seen[-1][1] - struck < transport.LEASE_MS / 10_000


def test_a_client_that_stands_still_for_a_second_keeps_its_link(endpoint: str, watch: Watch):
    with peer(endpoint) as process:
        assert until(watch.here)
        freeze(process.pid)
        time.sleep(1.0)
        wake(process.pid)
        heard = watch.news
        assert until(lambda: watch.news > heard + 3)
        assert [came for came, _ in watch.seen] == [True]


def test_a_client_that_is_frozen_loses_its_link_after_the_lease_and_gets_it_back(endpoint: str, watch: Watch):
    with peer(endpoint, lease_ms=300) as process:
        assert until(watch.here)
        freeze(process.pid)
        assert until(lambda: not watch.here())
        wake(process.pid)
        assert until(watch.here), "it comes back by itself"


def test_a_process_that_keeps_pythons_lock_for_a_second_is_not_lost(endpoint: str, watch: Watch):
    with peer(endpoint, busy=1) as process:
        assert process.stdout is not None and until(watch.here)
        assert process.stdout.readline() == "computed\n"
        time.sleep(0.3)
        assert [came for came, _ in watch.seen] == [True]
