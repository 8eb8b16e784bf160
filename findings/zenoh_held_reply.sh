#!/usr/bin/env bash
# With zenoh's default consolidation a reply is held until the other side lets go of the query.
#
# Version: eclipse-zenoh 1.10.2, Python 3.11; two sessions over TCP on the loopback address.
# Expected: a reply is handed over when it comes, as nothing else was sent on its key.
# Behaviour: with the default consolidation (of a plain key only the latest reply is wanted) it is handed over when the
#   query ends, here a second later; with ConsolidationMode.NONE at once.
# Output (seconds until the reply, rounded to halves):
#   default: 1.0
#   NONE: 0.0
# Remedy: ConsolidationMode.NONE in the question, or letting go of the query before doing anything else.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check eclipse-zenoh==1.10.2
"$folder/venv/bin/python" - <<'PYTHON'
import json
import socket
import threading
import time

import zenoh

with socket.create_server(("127.0.0.1", 0)) as probe:
    endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def session(**settings):
    """A session without discovery by multicast."""
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    for key, value in settings.items():
        config.insert_json5(key.replace("_", "/"), json.dumps(value))
    return zenoh.open(config)


def answer(query):
    """Reply at once, and keep the query for a second."""

    def keep():
        query.reply("cell/state", b"here")
        time.sleep(1.0)
        query.drop()

    threading.Thread(target=keep).start()


def seconds(**options):
    """Time from the question until the reply is there."""
    begun = time.monotonic()
    replies = iter(client.get("cell/state", timeout=5.0, **options))
    assert next(replies).ok.payload.to_bytes() == b"here"
    took = time.monotonic() - begun
    assert next(replies, None) is None
    return round(2 * took) / 2


with session(mode="peer", listen_endpoints=[endpoint]) as server, session(
    mode="client", connect_endpoints=[endpoint]
) as client:
    with server.declare_queryable("cell/state", answer):
        time.sleep(0.5)
        seen = {"default": seconds(), "NONE": seconds(consolidation=zenoh.ConsolidationMode.NONE)}
for name, took in seen.items():
    print(f"{name}: {took}")
raise SystemExit(0 if seen == {"default": 1.0, "NONE": 0.0} else "the behaviour has changed")
PYTHON
