"""Which processes offer which cameras, as their liveliness tokens say: `cell/camera/<camera>/<owner>`."""

import os
import re
import socket
from collections.abc import Mapping

import zenoh

from control.errors import ConfigError
from hw_interface.link.transport import CAMERA_KEY


def this_owner() -> str:
    """This process as a part of a key that people understand: "<host>-<process id>"."""
    return f"{re.sub(r'[^A-Za-z0-9.-]', '_', socket.gethostname())}-{os.getpid()}"


def camera_token(camera: str, owner: str) -> str:
    """Key of the token that says that `owner` has a camera."""
    return f"{CAMERA_KEY}/{camera}/{owner}"


def offered_cameras(session: zenoh.Session, timeout: float) -> dict[str, list[str]]:
    """Cameras that camera processes offer now, sorted by name, each with its owners.

    Args:
        session: Session of the one who asks.
        timeout: Longest wait for the tokens in [s].
    """
    found: dict[str, set[str]] = {}  # a session is told of its own tokens twice
    for reply in session.liveliness().get(f"{CAMERA_KEY}/*/*", timeout=timeout):
        if reply.ok is not None:
            camera, owner = str(reply.ok.key_expr).removeprefix(f"{CAMERA_KEY}/").split("/")
            found.setdefault(camera, set()).add(owner)
    return {camera: sorted(found[camera]) for camera in sorted(found)}


def all_cameras(own: tuple[str, ...], robot: str, offered: Mapping[str, list[str]]) -> tuple[str, ...]:
    """Names of all cameras: the robot process's own, then those that are offered.

    Args:
        own: Cameras of the robot process.
        robot: Its endpoint, for messages.
        offered: As from `offered_cameras`.

    Raises:
        ConfigError: Two processes offer the same camera.
    """
    for camera, owners in offered.items():
        claims = [f"camera process {owner}" for owner in owners]
        if camera in own:
            claims.insert(0, f"the robot process at {robot}")
        if len(claims) > 1:
            raise ConfigError(
                f"camera '{camera}' is offered by {' and by '.join(claims)}; end one of them, or give it another name"
            )
    return (*own, *offered)
