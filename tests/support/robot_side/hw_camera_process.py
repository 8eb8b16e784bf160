"""A camera process for tests: `python -m ...hw_camera_process ENDPOINT OWNER CAMERA...`; ends with its stdin.

A camera named `old` gives pictures of a minute ago, one named `blind` refuses.
"""

import sys
import threading
import time
from dataclasses import replace

from benchmarks.robot_side.perfect_robot import blank_frame
from control.errors import RefusedError
from hw_interface.cameras.node import CameraNode
from hw_interface.link.transport import open_client_session
from perception.frames import RgbdFrame


def take(camera: str) -> RgbdFrame:
    """A picture, as its camera's name says."""
    if camera == "blind":
        raise RefusedError("no_light", "it is dark")
    frame = blank_frame(camera)
    return replace(frame, stamp=time.time() - 60.0) if camera == "old" else frame


if __name__ == "__main__":
    endpoint, owner, *cameras = sys.argv[1:]
    session = open_client_session(endpoint)
    node = CameraNode(session, tuple(cameras), take, owner)
    print("ready", flush=True)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    while not ended.is_set():
        node.serve(0.05)
    node.close()
    session.close()
