#!/usr/bin/env bash
# A put of 100 MB with the default congestion control never arrives, even on the loopback address.
#
# Version: eclipse-zenoh 1.10.2, Python 3.11; two sessions over TCP on the loopback address, nothing else is sent.
# Expected: reliability is "reliable" by default, TCP loses nothing and the subscriber waits, so the sample arrives.
# Behaviour: the default is CongestionControl.DROP, and the sample is dropped whole. put returns as if it had been
#   sent.
# Output:
#   default: 0 bytes arrived
#   BLOCK: 100000000 bytes arrived
# Remedy: CongestionControl.BLOCK for everything that is large, such as clouds, pictures and files.
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


def arrived(**options):
    """Bytes of a put of 100 MB that the subscriber has seen after ten seconds at most."""
    sizes.clear()
    something.clear()
    sender.put("cell/cloud", bytes(100_000_000), **options)
    something.wait(10.0)
    return sum(sizes)


def take(sample):
    """Remember how large a sample was."""
    sizes.append(len(sample.payload))
    something.set()


sizes = []
something = threading.Event()
with session(mode="peer", listen_endpoints=[endpoint]) as receiver, session(
    mode="client", connect_endpoints=[endpoint]
) as sender:
    with receiver.declare_subscriber("cell/cloud", take):
        time.sleep(1.0)
        seen = {"default": arrived(), "BLOCK": arrived(congestion_control=zenoh.CongestionControl.BLOCK)}
for name, size in seen.items():
    print(f"{name}: {size} bytes arrived")
raise SystemExit(0 if seen == {"default": 0, "BLOCK": 100_000_000} else "the behaviour has changed")
PYTHON
