"""What truly stands in a cell and is in a camera's picture, on the wire: for scorers of simulated cells only.

Nothing that plans, perceives or verifies may ask for it.
"""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from hw_interface.errors import MessageError
from hw_interface.messages.robot import Name
from hw_interface.messages.wire import Message, array_field
from perception.ground_truth import CellTruth, FrameTruth, StandingThing, TrueJoint, TrueObject, box_around


class TruthRequest(Message):
    """Asks a simulated cell that was started for scoring what truly stands in it, and how."""

    type_name: ClassVar[str] = "truth_request"


class ThingTruth(Message):
    """One thing; the fields are those of `perception.ground_truth.StandingThing`."""

    type_name: ClassVar[str] = "thing_truth"
    name: Name
    world_T_object: array_field("<f8", (4, 4))  # type: ignore[valid-type]
    extents: array_field("<f8", (3,))  # type: ignore[valid-type]
    velocity: array_field("<f8", (6,))  # type: ignore[valid-type]
    fixed: bool


class JointTruth(Message):
    """One joint of furniture; the fields are those of `perception.ground_truth.TrueJoint`."""

    type_name: ClassVar[str] = "joint_truth"
    name: Name
    position: float
    fraction: float


class TruthMessage(Message):
    """Everything that stands in the cell.

    Attributes:
        stamp: When, on the robot process's wall clock in [s] since 1970.
        things, joints: As in `perception.ground_truth.CellTruth`.
    """

    type_name: ClassVar[str] = "truth"
    stamp: float
    things: tuple[ThingTruth, ...]
    joints: tuple[JointTruth, ...]

    @classmethod
    def of(cls, truth: CellTruth, stamp: float) -> "TruthMessage":
        """The message of a truth of this time in [s]."""
        things = tuple(
            ThingTruth(
                name=t.name,
                world_T_object=np.asarray(t.world_T_object, "<f8"),
                extents=np.asarray(t.extents, "<f8"),
                velocity=np.asarray(t.velocity, "<f8"),
                fixed=t.fixed,
            )
            for t in truth.things.values()
        )
        joints = tuple(
            JointTruth(name=j.name, position=float(j.position), fraction=float(j.fraction))
            for j in truth.joints.values()
        )
        return cls(stamp=stamp, things=things, joints=joints)

    def truth(self) -> CellTruth:
        """The truth in this message."""
        things = {t.name: StandingThing(t.name, t.world_T_object, t.extents, t.velocity, t.fixed) for t in self.things}
        return CellTruth(things, {j.name: TrueJoint(j.name, j.position, j.fraction) for j in self.joints})


class FrameTruthRequest(Message):
    """Asks a simulated cell that was started for scoring what truly is in a camera's picture now."""

    type_name: ClassVar[str] = "frame_truth_request"


class TrueThing(Message):
    """One thing; the fields are those of `perception.ground_truth.TrueObject`, without its mask."""

    type_name: ClassVar[str] = "true_thing"
    name: Name
    world_T_object: array_field("<f8", (4, 4))  # type: ignore[valid-type]
    extents: array_field("<f8", (3,))  # type: ignore[valid-type]
    shape: Literal["box", "cylinder", "sphere"] | None
    visible_share: Annotated[float, Field(ge=0.0, le=1.0)]
    joint_fractions: dict[Name, float]


class FrameTruthMessage(Message):
    """All things in a picture.

    Attributes:
        things: In the order of their labels, which begin at 1.
        labels: Which thing each pixel shows, 0 for none.
    """

    type_name: ClassVar[str] = "frame_truth"
    things: tuple[TrueThing, ...]
    labels: array_field("<u2", (None, None))  # type: ignore[valid-type]

    @classmethod
    def of(cls, truth: FrameTruth) -> "FrameTruthMessage":
        """The message of a truth whose objects all have a mask and extents."""
        labels, things = np.zeros((0, 0), "<u2"), []
        for number, o in enumerate(truth.objects, 1):
            assert o.mask is not None and o.extents is not None
            labels = labels if labels.size else np.zeros(o.mask.shape, "<u2")
            labels[o.mask] = number
            things.append(
                TrueThing(
                    name=o.name,
                    world_T_object=np.asarray(o.world_T_object, "<f8"),
                    extents=np.asarray(o.extents, "<f8"),
                    shape=o.shape,
                    visible_share=float(o.visible_share),
                    joint_fractions={k: float(v) for k, v in o.joint_fractions.items()},
                )
            )
        return cls(things=tuple(things), labels=labels)

    def truth(self) -> FrameTruth:
        """The truth in this message.

        Raises:
            MessageError: A thing without pixels.
        """
        objects = []
        for number, t in enumerate(self.things, 1):
            mask = self.labels == number
            if not mask.any():
                raise MessageError("labels", f"show nothing of '{t.name}'")
            box, fractions = box_around(mask), dict(t.joint_fractions)
            objects.append(
                TrueObject(t.name, t.world_T_object, t.extents, t.shape, mask, box, t.visible_share, fractions)
            )
        return FrameTruth(tuple(objects))
