"""What truly is in a camera's picture, on the wire: for scorers of simulated cells only."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from hw_interface.errors import MessageError
from hw_interface.messages import Name
from hw_interface.wire import Message, array_field
from perception.ground_truth import FrameTruth, TrueObject, box_around


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
