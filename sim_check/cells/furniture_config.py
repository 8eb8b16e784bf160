"""Furniture as a cell file describes it: kind and sizes. Where it stands and how far it is open is perceived.

All lengths are in [m]; widths are seen from the front, where `left` is the left hand's side.
"""

from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, Field, model_validator

from perception.catalogue.catalogue import builtin_catalogue
from sim_check.strict_config import NotNegative, Positive, Strict


def _painted(word: str) -> str:
    paints = builtin_catalogue().paints
    if word not in paints:
        raise ValueError(f"there is no colour '{word}'; colours are {', '.join(paints)}")
    return word


Colour = Annotated[str, AfterValidator(_painted)]  # a colour or material of the catalogue
BOARD = 0.02  # thickness of shell boards
NARROWEST_GAP = 0.015  # behind a handle, for fingertips


class _Doors(Strict):
    """What cabinets and microwaves share.

    Attributes:
        width, depth, height: Outer sizes of the shell.
        bottom: Height of the shell's lower edge above the table; a stand fills the space below.
        handle_height: Height of the handle's middle above the table; a Panda wants 0.2 or more.
        handle_length: Length of the bar between its stand-offs.
        handle_radius: Radius of the bar; fingers open at least 0.08.
        handle_standoff: From the door's front to the bar's axis.
        handle_inset: From the door's free edge to the bar's axis.
        door_range: How far a hinged door turns in [rad].
        door_friction: Dry friction of a door in [Nm], of a sliding one in [N].
        door_damping: Of a door in [Nm s/rad], of a sliding one in [N s/m].
        door_mass: Of each door in [kg].
        colour: Of the shell.
    """

    width: Positive = 0.60
    depth: Positive = 0.30
    height: Positive = 0.42
    bottom: NotNegative = 0.15
    handle_height: Positive = 0.35
    handle_length: Positive = 0.14
    handle_radius: Annotated[float, Field(ge=0.004, le=0.02)] = 0.008
    handle_standoff: Positive = 0.045
    handle_inset: Positive = 0.045
    door_range: Annotated[float, Field(gt=0.1, le=2.6)] = 1.9
    door_friction: NotNegative = 2.0
    door_damping: NotNegative = 2.0
    door_mass: Positive = 1.2
    colour: Colour = "wood"

    @model_validator(mode="after")
    def _can_be_built(self):
        if min(self.width, self.depth, self.height) < 5 * BOARD:
            raise ValueError(f"width, depth and height must each be at least {5 * BOARD} m")
        low, high = self.handle_height - self.handle_length / 2, self.handle_height + self.handle_length / 2
        if low < self.bottom + 0.01 or high > self.bottom + self.height - 0.01:
            raise ValueError(
                f"the handle reaches from {low:.3f} to {high:.3f} m above the table, beyond the door, which reaches "
                f"from {self.bottom} to {self.bottom + self.height:.3f}; change handle_height or handle_length"
            )
        if self.handle_standoff - self.handle_radius < NARROWEST_GAP:
            raise ValueError(f"handle_standoff must leave {NARROWEST_GAP} m between door and bar for the fingers")
        return self


class CabinetConfig(_Doors):
    """A cabinet on a stand, with hinged doors or a sliding one.

    Attributes:
        doors: How many hinged doors; not used by a sliding one.
        opening: How it opens. A sliding door covers half of the front and slides in front of the other half, which is
            closed for good.
        hinge: Side of a single hinged door's hinge; the side to which a sliding door slides open.
    """

    kind: Literal["cabinet"]
    doors: Literal[1, 2] = 2
    opening: Literal["hinged", "sliding"] = "hinged"
    hinge: Literal["left", "right"] = "left"

    def part_names(self, name: str) -> tuple[str, ...]:
        """Names of its doors, the left one first."""
        if self.opening == "hinged" and self.doors == 2:
            return (f"{name}_left_door", f"{name}_right_door")
        return (f"{name}_door",)


class MicrowaveConfig(_Doors):
    """A microwave on feet, with a door of its whole width."""

    kind: Literal["microwave"]
    width: Positive = 0.42
    height: Positive = 0.28
    bottom: NotNegative = 0.06
    handle_height: Positive = 0.21
    colour: Colour = "white"
    hinge: Literal["left", "right"] = "left"

    def part_names(self, name: str) -> tuple[str, ...]:
        """Name of its door."""
        return (f"{name}_door",)


class LeverConfig(Strict):
    """A rod with a knob on a post, upright when closed, that turns down towards the front.

    Attributes:
        pivot_height: Height of the hinge above the table.
        rod_length: From the hinge to the knob's far end.
        rod_radius: Of the rod.
        knob_length, knob_radius: Of the knob at the rod's end.
        lever_range: How far it turns in [rad].
        friction: Dry friction in [Nm].
        damping: In [Nm s/rad].
        colour: Of the knob.
    """

    kind: Literal["lever"]
    pivot_height: Positive = 0.26
    rod_length: Positive = 0.17
    rod_radius: Positive = 0.008
    knob_length: Positive = 0.07
    knob_radius: Annotated[float, Field(ge=0.004, le=0.02)] = 0.016
    lever_range: Annotated[float, Field(gt=0.1, le=1.6)] = 1.57
    friction: NotNegative = 1.0
    damping: NotNegative = 0.5
    colour: Colour = "red"

    @model_validator(mode="after")
    def _can_be_built(self):
        if self.rod_length < self.knob_length + 0.03:
            raise ValueError("rod_length must leave 0.03 m of rod below the knob")
        if self.pivot_height < 0.06:
            raise ValueError("pivot_height must be at least 0.06 m")
        return self

    def part_names(self, name: str) -> tuple[str, ...]:
        """Name of its rod."""
        return (f"{name}_rod",)


class WeightPlateConfig(Strict):
    """A plate on springs, that goes down under a weight.

    Attributes:
        width: Of the square plate.
        height: Of its upper side above the table, unloaded.
        travel: How far it goes down.
        mass: Weight in [kg] that presses it down by `RELEASE_SHARE` of its travel. With less than `LIGHT_SHARE` of
            this weight it does not move at all.
        colour: Of the plate.
    """

    kind: Literal["weight_plate"]
    width: Positive = 0.13
    height: Annotated[float, Field(ge=0.02)] = 0.03
    travel: Annotated[float, Field(gt=0.001, le=0.012)] = 0.008
    mass: Positive = 0.3
    colour: Colour = "grey"

    def part_names(self, name: str) -> tuple[str, ...]:
        """Name of its plate."""
        return (f"{name}_plate",)


FurnitureConfig = Annotated[
    CabinetConfig | MicrowaveConfig | LeverConfig | WeightPlateConfig, Field(discriminator="kind")
]


def furniture_kinds() -> tuple[str, ...]:
    """Kinds that a cell file may name."""
    configs = get_args(get_args(FurnitureConfig)[0])
    return tuple(get_args(c.model_fields["kind"].annotation)[0] for c in configs)
