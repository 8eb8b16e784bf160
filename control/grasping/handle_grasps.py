"""Poses of the tool at a bar: a door's handle, a lever's knob, a kettle's handle; from the bar's shape alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.grasping.grasps import pose, tcp_frame
from control.twin_model import Handle

# Approaches about the bar, from its outward side.
AROUND = np.radians([0.0, 20.0, -20.0, 35.0, -35.0, 55.0, -55.0, 75.0, -75.0])
TILTS = np.radians([0.0, 25.0, -25.0, 45.0, -45.0, 65.0, -65.0])  # of the approach along the bar
BESIDE_BOX = np.radians([0.0, 90.0, -90.0])  # the approaches about a bar with flat sides
ALONG = (0.0, 0.5, -0.5)  # points on the bar, in half lengths


@dataclass(frozen=True)
class HandleGrasp:
    """A pose of the tool at a handle.

    Attributes:
        world_T_tcp: Tool between the pads around the bar, shape (4, 4).
        width: Distance between the pads around it in [m].
        text: For people.
    """

    world_T_tcp: NDArray[np.float64]
    width: float
    text: str


def handle_grasps(handle: Handle, world_T_body: np.ndarray) -> list[HandleGrasp]:
    """Poses of the tool with the bar between the pads: around it, tilted along it, at several points, either way up."""
    rotation = world_T_body[:3, :3]
    axis, outward = rotation @ handle.axis, rotation @ handle.outward
    side = np.cross(axis, outward)
    centre = rotation @ handle.centre + world_T_body[:3, 3]
    out = []
    for around in AROUND if handle.shape == "capsule" else BESIDE_BOX:
        radial = -(np.cos(around) * outward + np.sin(around) * side)
        width = 2 * (handle.half_width if abs(around) < np.pi / 4 or handle.shape == "capsule" else handle.half_depth)
        for tilt in TILTS:
            approach = np.cos(tilt) * radial - np.sin(tilt) * axis
            for flip in (1.0, -1.0):
                turn = tcp_frame(approach, flip * np.cross(axis, radial))
                text = f"{np.degrees(around):.0f} deg about the bar, {np.degrees(tilt):.0f} deg along it"
                out += [
                    HandleGrasp(pose(turn, centre + share * handle.half_length * axis), width, text) for share in ALONG
                ]
    return out
