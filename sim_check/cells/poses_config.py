"""What a person may write down about where things stand: the `poses` of a cell file, or a scene file."""

from typing import Annotated

from pydantic import Field

from perception.estimates import Shape
from sim_check.strict_config import Fraction, Name, NotNegative, Positive, Strict, Vector2, Vector3


class PoseConfig(Strict):
    """Where one object or piece of furniture stands, upright.

    Attributes:
        position: Its middle in the world in [m]: (x, y) for a thing that stands on the table or on `stands_on`, or
            (x, y, z).
        yaw_deg: Rotation about the world's z in [degrees]. Furniture with yaw 0 faces -x, where the robot is.
        extents: Full sizes in [m]; the library's usual ones if left out. Not for furniture.
        shape: Its solid, for nouns that the library lacks.
        stands_on: Object or furniture on whose top it stands.
        spread_mm: How well the position is known: one standard deviation along each axis in [mm].
        yaw_spread_deg: How well the yaw is known: one standard deviation in [degrees].
        joints: How far joints of furniture are open, 0 closed .. 1 open; closed if left out.
    """

    position: Vector2 | Vector3
    yaw_deg: float = 0.0
    extents: tuple[Positive, Positive, Positive] | None = None
    shape: Shape | None = None
    stands_on: Name | None = None
    spread_mm: NotNegative = 2.0
    yaw_spread_deg: NotNegative = 1.5
    joints: dict[Name, Fraction] = Field(default_factory=dict)


class SceneConfig(Strict):
    """A scene file.

    Attributes:
        table: Height of the table top in the world in [m].
        poses: What stands where, by name.
    """

    table: float = 0.0
    poses: Annotated[dict[Name, PoseConfig], Field(min_length=1)]
