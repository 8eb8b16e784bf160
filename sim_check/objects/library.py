"""What nouns are made of: geometry, mass and friction of things, for the simulated cell and for the twin.

The simulated cell builds objects in their usual sizes; the twin builds them in the sizes that perception estimated.
An object's frame lies at the centre of its box with z up, as in `perception.estimates`. Sizes are full sizes in [m].

A noun that the library lacks becomes the solid that perception fitted, with `UNKNOWN_DENSITY`.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from control.errors import ConfigError
from control.twin_model import Handle
from perception.estimates import Shape

SolidKind = Literal["box", "sphere", "ellipsoid", "cylinder", "capsule"]

UNKNOWN_DENSITY = 400.0  # [kg/m^3]; toys and packed food lie between balsa (150) and fruit (900)
UNKNOWN_FRICTION = 0.6
SMALLEST, LARGEST = 0.004, 2.0  # sizes in [m] that anything here may have
# Friction on sliding is a number; torsion and rolling are lengths in [m]: a fruit stops rolling after a few turns.
TORSION, ROLLING = 0.005, 0.0008

COLOURS: dict[str, tuple[float, float, float]] = {
    "red": (0.78, 0.07, 0.06),
    "orange": (0.92, 0.42, 0.05),
    "brown": (0.47, 0.30, 0.16),
    "yellow": (0.92, 0.76, 0.06),
    "green": (0.12, 0.52, 0.18),
    "cyan": (0.10, 0.65, 0.70),
    "blue": (0.10, 0.25, 0.68),
    "purple": (0.42, 0.18, 0.60),
    "pink": (0.90, 0.42, 0.60),
    "white": (0.90, 0.90, 0.88),
    "grey": (0.50, 0.50, 0.50),
    "black": (0.06, 0.06, 0.06),
}
WOOD = (0.66, 0.47, 0.30)


def rgb_of(colour: str) -> tuple[float, float, float]:
    """Colour, 0..1, of a name from `COLOURS` or of "wood"."""
    return WOOD if colour == "wood" else COLOURS[colour]


@dataclass(frozen=True)
class SolidShape:
    """One primitive of an object's collision body.

    Attributes:
        kind: Which primitive; a cylinder's and a capsule's axis is its z.
        half: Half sizes in [m], shape (3,); a cylinder is (radius, radius, half height), a capsule (radius, radius,
            half of its straight part).
        position: Its centre in the object's frame in [m], shape (3,).
        quat: Its orientation in the object's frame, (w, x, y, z).
    """

    kind: SolidKind
    half: np.ndarray
    position: np.ndarray = field(default_factory=lambda: np.zeros(3))
    quat: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))

    @property
    def volume(self) -> float:
        """In [m^3]."""
        if self.kind == "capsule":
            radius, half = self.half[0], self.half[2]
            return float(2 * np.pi * radius**2 * half + 4 / 3 * np.pi * radius**3)
        factor = {"box": 8.0, "sphere": 4 / 3 * np.pi, "ellipsoid": 4 / 3 * np.pi, "cylinder": 2 * np.pi}[self.kind]
        return float(factor * np.prod(self.half))


@dataclass(frozen=True)
class ObjectModel:
    """An object ready to be built.

    Attributes:
        name: Scene name.
        noun: The library's noun, or None for one that it lacks.
        extents: Full sizes along its own axes in [m], shape (3,).
        solids: Collision body.
        mass: In [kg].
        friction: Sliding (a number), torsion and rolling (lengths in [m]), shape (3,).
        rolls: Whether it has a round surface, so that rolling friction matters.
        movable: Whether it is free to move.
        container: Whether things are put into it.
        inner_floor: Height of a container's inner floor above its lowest point in [m], else 0.
        inner_radius: Radius of a container's opening in [m], else 0.
        rgb: Colour, 0..1.
        handle: What to take hold of when the whole is too wide for the gripper, in the object's frame; or None.
    """

    name: str
    noun: str | None
    extents: np.ndarray
    solids: tuple[SolidShape, ...]
    mass: float
    friction: np.ndarray
    rolls: bool
    movable: bool
    container: bool
    inner_floor: float
    inner_radius: float
    rgb: tuple[float, float, float]
    handle: Handle | None = None

    @property
    def footprint_radius(self) -> float:
        """Radius of the circle around its footprint in [m]."""
        if self.rolls or self.container:
            return float(max(self.extents[:2])) / 2
        return float(np.hypot(*self.extents[:2])) / 2


@dataclass(frozen=True)
class _Noun:
    """A row of the library.

    Attributes:
        form: How its body is built.
        extents: Usual full sizes in [m].
        density: Mass over the volume of its solids in [kg/m^3].
        friction: Sliding friction.
        colour: Usual colour.
    """

    form: Literal["box", "round", "cylinder", "bowl", "kettle"]
    extents: tuple[float, float, float]
    density: float
    friction: float
    colour: str


# Densities: beech 700, a crate is mostly air; fruit floats just so; glazed stoneware 2200; a full drinks can 1000.
_NOUNS: dict[str, _Noun] = {
    "cube": _Noun("box", (0.05, 0.05, 0.05), 700.0, 0.7, "red"),
    "block": _Noun("box", (0.05, 0.04, 0.04), 700.0, 0.7, "blue"),
    "box": _Noun("box", (0.09, 0.06, 0.06), 300.0, 0.6, "brown"),
    "crate": _Noun("box", (0.11, 0.11, 0.06), 700.0, 0.7, "brown"),
    "bar": _Noun("box", (0.26, 0.02, 0.02), 700.0, 0.6, "red"),
    "apple": _Noun("round", (0.069, 0.069, 0.069), 840.0, 0.6, "red"),
    "orange": _Noun("round", (0.072, 0.072, 0.072), 900.0, 0.6, "orange"),
    "lemon": _Noun("round", (0.066, 0.051, 0.051), 950.0, 0.6, "yellow"),
    "ball": _Noun("round", (0.06, 0.06, 0.06), 300.0, 0.7, "red"),
    "can": _Noun("cylinder", (0.066, 0.066, 0.115), 1000.0, 0.5, "red"),
    "cylinder": _Noun("cylinder", (0.05, 0.05, 0.08), 700.0, 0.6, "green"),
    "bowl": _Noun("bowl", (0.144, 0.144, 0.053), 2200.0, 0.4, "blue"),
    "kettle": _Noun("kettle", (0.13, 0.10, 0.20), 700.0, 0.5, "blue"),
}
# A kettle's shares: body's height; length of spout beyond the body against the whole length. Its handle is a round bar
# that the hand can always close on, however large the kettle was seen.
_KETTLE_BODY, _KETTLE_SPOUT, _KETTLE_BAR = 0.66, 0.23, 0.009
_BOWL_SEGMENTS = 16
# Shares of a bowl's outer radius (wall, foot) and of its height (floor); a soup bowl's proportions.
_BOWL_WALL, _BOWL_FOOT, _BOWL_FLOOR = 0.065, 0.66, 0.11
# Gap under the wall, so that a bowl stands on its foot alone.
_BOWL_LIFT = 0.0015


def known_nouns() -> tuple[str, ...]:
    """Nouns of the library."""
    return tuple(sorted(_NOUNS))


def noun_of(name: str) -> str | None:
    """The library's noun in a scene name (`red_cube` -> "cube"), or None."""
    return next((word for word in reversed(name.split("_")) if word in _NOUNS), None)


def object_model(name: str, extents: np.ndarray | None = None, shape: Shape | None = None) -> ObjectModel:
    """Build what a name stands for.

    Args:
        name: Scene name, for instance "red_cube".
        extents: Full sizes in [m], shape (3,); the noun's usual ones if None.
        shape: Solid that perception fitted; used for nouns that the library lacks.

    Raises:
        ConfigError: The library lacks the noun and sizes or shape are not given, or sizes are not sizes of a thing.
    """
    noun = noun_of(name)
    row = _NOUNS.get(noun) if noun else None
    if row is None and (extents is None or shape is None):
        raise ConfigError(f"the object library has no noun for '{name}'; it has {', '.join(known_nouns())}")
    sizes = np.array(row.extents if extents is None and row else extents, dtype=float)
    if sizes.shape != (3,) or not np.all((sizes >= SMALLEST) & (sizes <= LARGEST)):
        raise ConfigError(
            f"sizes of '{name}' are {sizes} m; each of the three must lie within {SMALLEST} and {LARGEST}"
        )
    form = row.form if row else {"box": "box", "sphere": "round", "cylinder": "cylinder"}[shape or "box"]
    inner_floor = inner_radius = 0.0
    handle = None
    if form == "bowl":
        solids, sizes, inner_floor, inner_radius = _bowl(sizes)
    elif form == "round":
        solids, sizes = _round(sizes)
    elif form == "kettle":
        solids, handle = _kettle(name, sizes)
    elif form == "cylinder":
        radius = (sizes[0] + sizes[1]) / 4
        sizes = np.array([2 * radius, 2 * radius, sizes[2]])
        solids = (SolidShape("cylinder", sizes / 2),)
    else:
        solids = (SolidShape("box", sizes / 2),)
    sliding = row.friction if row else UNKNOWN_FRICTION
    return ObjectModel(
        name=name,
        noun=noun,
        extents=sizes,
        solids=solids,
        mass=(row.density if row else UNKNOWN_DENSITY) * sum(s.volume for s in solids),
        friction=np.array([sliding, TORSION, ROLLING]),
        rolls=form == "round",
        movable=True,
        container=form == "bowl",
        inner_floor=inner_floor,
        inner_radius=inner_radius,
        rgb=_colour(name, noun, row),
        handle=handle,
    )


def _colour(name: str, noun: str | None, row: _Noun | None) -> tuple[float, float, float]:
    words = name.split("_")
    # "orange" is a fruit when it is the noun.
    named = [w for w in words if w in COLOURS and not (w == noun and words.count(w) == 1)]
    return COLOURS[named[0] if named else row.colour if row else "grey"]


def _round(sizes: np.ndarray) -> tuple[tuple[SolidShape, ...], np.ndarray]:
    """A sphere when the sizes differ by less than a tenth (perception's noise), else an ellipsoid."""
    if sizes.max() < 1.1 * sizes.min():
        sizes = np.full(3, sizes.mean())
        return (SolidShape("sphere", sizes / 2),), sizes
    return (SolidShape("ellipsoid", sizes / 2),), sizes


def bowl_profile(extents: np.ndarray) -> np.ndarray:
    """Outline of a bowl's wall, in the plane of radius and height above its lowest point.

    The outer face runs from the foot (radius 0.66 R) to the rim; the wall has the same thickness t all along. With
    the lean a of the wall against the vertical and the length L of its faces, the rim's highest point is the inner
    face's end, and the outer face's end is the widest point:

        lift + L cos(a) + t sin(a) = height        0.66 R + L sin(a) = R

    Args:
        extents: Full sizes in [m], shape (3,).

    Returns:
        Foot and rim of the outer face, then rim and foot of the inner face: (radius, height) in [m], shape (4, 2).
    """
    radius, height = (extents[0] + extents[1]) / 4, extents[2]
    thickness, foot = _BOWL_WALL * radius, _BOWL_FOOT * radius
    lean = 0.0
    for _ in range(20):  # a fixed point: thickness is small against the height
        lean = np.arctan2(radius - foot, height - _BOWL_LIFT - thickness * np.sin(lean))
    length = (radius - foot) / np.sin(lean)
    along, inwards = np.array([np.sin(lean), np.cos(lean)]), np.array([-np.cos(lean), np.sin(lean)])
    low = np.array([foot, _BOWL_LIFT])
    high = low + length * along
    return np.stack([low, high, high + thickness * inwards, low + thickness * inwards])


def _bowl(sizes: np.ndarray) -> tuple[tuple[SolidShape, ...], np.ndarray, float, float]:
    """A floor and a ring of leaning boards."""
    radius = (sizes[0] + sizes[1]) / 4
    sizes = np.array([2 * radius, 2 * radius, sizes[2]])
    low, high, inner_high, inner_low = bowl_profile(sizes)
    centre = (low + high + inner_high + inner_low) / 4
    length, thickness = np.linalg.norm(high - low), np.linalg.norm(inner_low - low)
    lean = np.arctan2(*(high - low))
    floor = max(_BOWL_FLOOR * sizes[2], 2 * _BOWL_LIFT)
    # Boards meet at the rim; further down they overlap.
    half = np.array([thickness, 2 * np.tan(np.pi / _BOWL_SEGMENTS) * high[0], length]) / 2
    solids = [SolidShape("cylinder", np.array([low[0], low[0], floor / 2]), np.array([0, 0, (floor - sizes[2]) / 2]))]
    for angle in 2 * np.pi * np.arange(_BOWL_SEGMENTS) / _BOWL_SEGMENTS:
        position = np.array([centre[0] * np.cos(angle), centre[0] * np.sin(angle), centre[1] - sizes[2] / 2])
        turn, tilt = np.array([angle, lean]) / 2
        # About z by the segment's angle, then about its y by the lean.
        quat = np.array(
            [
                np.cos(turn) * np.cos(tilt),
                -np.sin(turn) * np.sin(tilt),
                np.cos(turn) * np.sin(tilt),
                np.sin(turn) * np.cos(tilt),
            ]
        )
        solids.append(SolidShape("box", half, position, quat))
    return tuple(solids), sizes, float(floor), float(inner_high[0])


def _kettle(name: str, sizes: np.ndarray) -> tuple[tuple[SolidShape, ...], Handle]:
    """A round body, a spout towards +x, and above the body a bar along x on two posts."""
    half, bar = sizes / 2, _KETTLE_BAR
    radius = min(float(half[1]), sizes[0] * (1 - _KETTLE_SPOUT) / 2)
    middle = radius - half[0]  # x of the body's axis; the spout takes the rest
    lid = _KETTLE_BODY * sizes[2] - half[2]
    height = half[2] - bar  # z of the bar's axis
    reach = 0.75 * radius
    level = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])  # z to x
    post = np.array([0.7 * bar, 0.7 * bar, (height - lid) / 2])
    spout = (half[0] - (middle + 0.8 * radius)) / 2
    solids = (
        SolidShape(
            "cylinder", np.array([radius, radius, (lid + half[2]) / 2]), np.array([middle, 0.0, (lid - half[2]) / 2])
        ),
        SolidShape("capsule", np.array([bar, bar, reach]), np.array([middle, 0.0, height]), level),
        SolidShape("cylinder", post, np.array([middle - reach, 0.0, (lid + height) / 2])),
        SolidShape("cylinder", post, np.array([middle + reach, 0.0, (lid + height) / 2])),
        SolidShape("cylinder", np.array([0.012, 0.012, spout]), np.array([half[0] - spout, 0.0, 0.6 * lid]), level),
    )
    handle = Handle(
        body=name,
        shape="capsule",
        centre=np.array([middle, 0.0, height]),
        axis=np.array([1.0, 0.0, 0.0]),
        outward=np.array([0.0, 0.0, 1.0]),
        half_length=reach - 0.01 - 0.7 * bar,
        half_width=bar,
        half_depth=bar,
        clearance=float(height - bar - lid),
    )
    return solids, handle
