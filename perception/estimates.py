"""What perception believes: objects with poses. Needs numpy only."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from perception.seen_space import SeenSpace

Shape = Literal["box", "cylinder", "sphere"]


@dataclass(frozen=True)
class Evidence:
    """Where in which picture an object was seen.

    Attributes:
        camera: Name of the camera.
        box_px: (x0, y0, x1, y1) in [px], float, shape (4,).
        mask: Pixels of the object, bool, shape (height, width).
        depth_share: Share of the mask's pixels with valid depth, 0..1.
        source: Which detector and which segmenter, for instance "colour-and-shape (OpenCV) + GrabCut-and-depth".
    """

    camera: str
    box_px: np.ndarray
    mask: NDArray[np.bool_]
    depth_share: float
    source: str


@dataclass(frozen=True)
class ObjectEstimate:
    """One named object as perceived.

    Attributes:
        name: Name in the scene, lower case with underscores, for instance "red_cube".
        phrase: What the detector was asked for, for instance "red cube".
        world_T_object: Pose of the object's box centre; z is up for boxes resting on something, shape (4, 4).
        extents: Full sizes along the object's own axes in [m], shape (3,).
        shape: Which solid was fitted. A sphere or an upright cylinder has no meaningful yaw.
        position_std: Spread of the position estimate along the world's axes in [m], shape (3,).
        yaw_std: Spread of the yaw in [rad]; infinite where yaw has no meaning.
        score: Detector's confidence, 0..1.
        stamp: Time of the frame in [s].
        evidence: Pictures, one per camera that saw it.
        joint_fractions: How far each of its joints is open, 0 closed .. 1 open, by joint name; empty for things
            without joints. A joint of furniture that is left out counts as closed.
        joint_stds: Spreads of these fractions by joint name; about 0.5 where no camera saw the joint's part.
        extents_std: Spread of the extents in [m], shape (3,), or None where nobody says; a side that something hides,
            or that no camera sees, has a large one.
        colour: Its colour in a word of the catalogue, or None where nobody says or it is
            undecided.
        doubts: What speaks against it, a clause each: it floats, fills another thing's place, or too little of it is
            seen. Such a thing stands in the way like any other and is not taken hold of.
        named: Whether somebody named it; otherwise it is depth that nothing explains, in a box on the safe side.
    """

    name: str
    phrase: str
    world_T_object: NDArray[np.float64]
    extents: NDArray[np.float64]
    shape: Shape
    position_std: NDArray[np.float64]
    yaw_std: float
    score: float
    stamp: float
    evidence: tuple[Evidence, ...] = ()
    joint_fractions: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    joint_stds: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    extents_std: NDArray[np.float64] | None = None
    colour: str | None = None
    doubts: tuple[str, ...] = ()
    named: bool = True

    @property
    def position(self) -> np.ndarray:
        """Centre in the world in [m], shape (3,)."""
        return self.world_T_object[:3, 3]

    @property
    def yaw(self) -> float:
        """Rotation about the world's z in [rad], of the object's x axis."""
        return float(np.arctan2(self.world_T_object[1, 0], self.world_T_object[0, 0]))

    @property
    def top(self) -> float:
        """Height of the highest point in [m], for a box whose z is up."""
        return float(self.world_T_object[2, 3] + self.extents[2] / 2)


@dataclass(frozen=True)
class Unseen:
    """A name that was looked for and yielded no pose, and why.

    Attributes:
        name: Name in the scene.
        reason: For instance "no box above the threshold" or "not enough depth (12 % of its pixels)".
    """

    name: str
    reason: str


@dataclass(frozen=True)
class SceneEstimate:
    """Everything perceived at one time.

    Attributes:
        objects: One estimate per object seen.
        unseen: Names that were looked for in vain.
        support_height: Height of the table top in the world in [m].
        stamp: Time of the newest frame used in [s].
        source: Which detector and segmenter, for people to read.
        seconds: Time spent in each stage in [s].
        seen: Which space its frames have looked into; None where nobody says.
    """

    objects: tuple[ObjectEstimate, ...]
    unseen: tuple[Unseen, ...]
    support_height: float
    stamp: float
    source: str
    seconds: dict[str, float] = field(default_factory=dict)
    seen: SeenSpace | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the objects seen, in their order."""
        return tuple(o.name for o in self.objects)

    def get(self, name: str) -> ObjectEstimate | None:
        """The object of this name, or None."""
        return next((o for o in self.objects if o.name == name), None)
