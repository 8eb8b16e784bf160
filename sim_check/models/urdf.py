"""Reads what MuJoCo's own URDF reader would merge or drop: every link by itself, in order, with its origins."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from control.errors import ConfigError


@dataclass(frozen=True)
class UrdfLink:
    """One link and the joint that carries it.

    Attributes:
        name: Name of the link.
        joint: The <joint> whose child it is; None for the root.
        parent: Name of the parent link; None for the root.
        element: The <link> itself.
    """

    name: str
    joint: ElementTree.Element | None
    parent: str | None
    element: ElementTree.Element

    @property
    def mass(self) -> float:
        """Mass in [kg]; zero for a mere frame."""
        inertial = self.element.find("inertial")
        return 0.0 if inertial is None else number(child(inertial, "mass"), "value")


def read_links(path: Path) -> list[UrdfLink]:
    """All links of a URDF file, parents before children.

    Raises:
        ConfigError: A joint lacks its parent or child.
    """
    root = ElementTree.parse(path).getroot()
    elements = {str(e.get("name")): e for e in root.findall("link")}
    joints = root.findall("joint")
    carrying = {str(child(j, "child").get("link")): j for j in joints}
    ordered: list[UrdfLink] = []
    waiting = [name for name in elements if name not in carrying]
    while waiting:
        name = waiting.pop(0)
        joint = carrying.get(name)
        parent = None if joint is None else str(child(joint, "parent").get("link"))
        ordered.append(UrdfLink(name, joint, parent, elements[name]))
        waiting += [below for below, j in carrying.items() if child(j, "parent").get("link") == name]
    return ordered


def child(element: ElementTree.Element, tag: str) -> ElementTree.Element:
    """The first element of this tag.

    Raises:
        ConfigError: There is none.
    """
    found = element.find(tag)
    if found is None:
        where = f"<{element.tag} name='{element.get('name')}'>" if element.get("name") else f"<{element.tag}>"
        raise ConfigError(f"the robot's URDF has no <{tag}> in {where}; install the locked example-robot-data")
    return found


def number(element: ElementTree.Element, attribute: str) -> float:
    """A numeric attribute; zero where it is not given, as URDF has it."""
    return float(element.get(attribute, "0"))


def numbers(text: str | None) -> np.ndarray:
    """Three numbers of an attribute; zeros where it is not given, as URDF has it."""
    return np.array([float(x) for x in (text or "0 0 0").split()])


def origin(element: ElementTree.Element) -> tuple[np.ndarray, np.ndarray]:
    """Position in [m], shape (3,), and quaternion (w, x, y, z) of an element's <origin>."""
    place = element.find("origin")
    quat = np.array([1.0, 0.0, 0.0, 0.0])
    if place is None:
        return np.zeros(3), quat
    # URDF: fixed-axis roll, pitch, yaw, which MuJoCo calls "XYZ" in capitals.
    mujoco.mju_euler2Quat(quat, numbers(place.get("rpy")), "XYZ")
    return numbers(place.get("xyz")), quat
