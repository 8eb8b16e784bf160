"""How collision bodies of the robot look and touch: shells, and the pads that hold things."""

import mujoco

COLLISION_GROUP = 3
PICTURE_GROUP = 2
PAD_NAMES = ("left_pad", "right_pad")
# Collision bodies are translucent, for pictures that show them over the meshes.
SHELL_RGBA = (0.9, 0.5, 0.2, 0.4)
FINGER_RGBA = (0.2, 0.2, 0.2, 0.6)


def make_shell(geom: mujoco.MjsGeom, rgba: tuple[float, ...] = SHELL_RGBA) -> None:
    """A collision body of arm, hand or finger."""
    geom.group = COLLISION_GROUP
    geom.friction = [0.6, 0.005, 0.0001]
    geom.rgba = rgba


def make_pad(geom: mujoco.MjsGeom) -> None:
    """A pad: stiff, with torsional friction, and in force whatever it touches (priority)."""
    make_shell(geom, FINGER_RGBA)
    geom.condim = 4
    geom.priority = 1
    geom.friction = [1.0, 0.01, 0.0005]
    geom.solref = [0.004, 1.0]
    geom.solimp = [0.95, 0.99, 0.001, 0.5, 2.0]
