"""What truly was in the frames of a recorded simulated cell: one JSON text a frame. For scorers only.

It is the `data` of a std_msgs/String on the topic `/replan/truth`:

    {"camera": "static", "stamp_ns": 1700000000000000000, "absent": ["lime"],
     "objects": [{"name": "red_cube", "world_T_object": [[...], [...], [...], [...]], "extents": [0.05, 0.05, 0.05],
                  "shape": "box", "label": 1, "visible_share": 0.8, "joint_fractions": {"door": 0.5}}]}

Camera and stamp are those of the frame; units are metres. `label` is the object's value in the picture of labels that
was recorded with the frame (topic `/<camera>/truth/labels`, mono16), where there is one.
"""

from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from perception.errors import FrameError
from perception.ground_truth import FrameTruth, TrueObject, box_around

TRUTH_TOPIC = "/replan/truth"
LABELS_ENDING = "/truth/labels"

Row = tuple[float, float, float, float]


class RecordedObject(BaseModel):
    """One thing; the fields are those of `perception.ground_truth.TrueObject`."""

    model_config = ConfigDict(extra="forbid")
    name: str = Field(min_length=1)
    world_T_object: tuple[Row, Row, Row, Row]
    extents: tuple[float, float, float] | None = None
    shape: Literal["box", "cylinder", "sphere"] | None = None
    label: int | None = Field(default=None, ge=1, le=65535)
    visible_share: float = Field(default=1.0, ge=0.0, le=1.0)
    joint_fractions: dict[str, float] = Field(default_factory=dict)


class RecordedTruth(BaseModel):
    """What truly was in one frame."""

    model_config = ConfigDict(extra="forbid")
    camera: str
    stamp_ns: int
    objects: tuple[RecordedObject, ...]
    absent: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str) -> "RecordedTruth":
        """From the text of a message.

        Raises:
            FrameError: It is not of this form (names the field).
        """
        try:
            return cls.model_validate_json(text)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"]) or "text"
            raise FrameError(f"the truth of a frame is not valid: {where}: {first['msg']}") from error

    def truth(self, labels: np.ndarray | None = None) -> FrameTruth:
        """As scorers want it.

        Args:
            labels: Picture of labels of the frame, integers, shape (height, width); objects that have a label and none
                of its pixels are left out.
        """
        found = []
        for o in self.objects:
            mask = labels == o.label if labels is not None and o.label is not None else None
            if mask is not None and not mask.any():
                continue
            found.append(
                TrueObject(
                    o.name,
                    np.array(o.world_T_object, float),
                    None if o.extents is None else np.array(o.extents, float),
                    o.shape,
                    mask,
                    None if mask is None else box_around(mask),
                    o.visible_share,
                    dict(o.joint_fractions),
                )
            )
        return FrameTruth(tuple(found), self.absent)
