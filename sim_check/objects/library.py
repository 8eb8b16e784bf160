"""What nouns are made of: geometry, mass and friction of things, for the simulated cell and for the twin.

The simulated cell builds objects in their usual sizes; the twin builds them in the sizes that perception estimated.
An object's frame lies at the centre of its box with z up, as in `perception.estimates`. Sizes are full sizes in [m].

Sizes, densities and friction stand in the catalogue (`perception.catalogue`). A noun that has no body there becomes the
solid that perception fitted, with the density and friction of unknown things.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.errors import ConfigError
from control.twin_model import Handle
from perception.catalogue.catalogue import Catalogue, builtin_catalogue
from perception.catalogue.entries import BodyEntry, ModelName, ObjectEntry, VisualName
from perception.estimates import Shape
from sim_check.objects.bowl import bowl
from sim_check.objects.kettle import kettle
from sim_check.objects.solids import Built, SolidShape

SMALLEST, LARGEST = 0.004, 2.0  # sizes in [m] that anything here may have
# Friction on sliding is a number; torsion and rolling are lengths in [m]: a fruit stops rolling after a few turns.
TORSION, ROLLING = 0.005, 0.0008
# What builds the bodies that are no primitives, by the catalogue's name, from scene name and full sizes in [m].
MODELS: Mapping[ModelName, Callable[[str, np.ndarray], Built]] = {"bowl": bowl, "kettle": kettle}


@dataclass(frozen=True)
class ObjectModel:
    """An object ready to be built.

    Attributes:
        name: Scene name.
        noun: The library's noun, or None for one that it lacks.
        shape: Solid that describes it.
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
        visual: What draws it for cameras, where that is not its solids.
    """

    name: str
    noun: str | None
    shape: Shape
    extents: NDArray[np.float64]
    solids: tuple[SolidShape, ...]
    mass: float
    friction: NDArray[np.float64]
    rolls: bool
    movable: bool
    container: bool
    inner_floor: float
    inner_radius: float
    rgb: tuple[float, float, float]
    handle: Handle | None = None
    visual: VisualName | None = None

    @property
    def footprint_radius(self) -> float:
        """Radius of the circle around its footprint in [m]."""
        if self.rolls or self.container:
            return float(max(self.extents[:2])) / 2
        return float(np.hypot(*self.extents[:2])) / 2


def known_nouns(catalogue: Catalogue | None = None) -> tuple[str, ...]:
    """Nouns that have a body in a catalogue, the built-in one if None; sorted."""
    return tuple(sorted(_bodies(catalogue or builtin_catalogue())))


def noun_of(name: str, catalogue: Catalogue | None = None) -> str | None:
    """The library's noun in a scene name (`red_cube` -> "cube"), or None."""
    bodies = _bodies(catalogue or builtin_catalogue())
    return next((word for word in reversed(name.split("_")) if word in bodies), None)


def object_model(
    name: str,
    extents: np.ndarray | None = None,
    shape: Shape | None = None,
    catalogue: Catalogue | None = None,
) -> ObjectModel:
    """Build what a name stands for.

    Args:
        name: Scene name, for instance "red_cube".
        extents: Full sizes in [m], shape (3,); the noun's usual ones if None.
        shape: Solid that perception fitted; used for nouns that the library lacks.
        catalogue: Of nouns; the built-in one if None.

    Raises:
        ConfigError: The library lacks the noun and sizes or shape are not given, sizes are not sizes of a thing, or
            the noun's entry asks for what its model does not have.
    """
    known = catalogue or builtin_catalogue()
    noun = noun_of(name, known)
    body = None if noun is None else known.objects[noun].body
    if body is None and (extents is None or shape is None):
        raise ConfigError(f"the object library has no noun for '{name}'; it has {', '.join(known_nouns(known))}")
    sizes = np.array(body.extents if extents is None and body else extents, dtype=float)
    if sizes.shape != (3,) or not np.all((sizes >= SMALLEST) & (sizes <= LARGEST)):
        raise ConfigError(
            f"sizes of '{name}' are {sizes} m; each of the three must lie within {SMALLEST} and {LARGEST}"
        )
    solid = known.objects[noun].shape if noun is not None else shape or known.unknown.shape
    built = _built(name, solid, body, sizes)
    if noun is not None:
        _check(known, noun, built)
    friction = body.friction if body else None
    return ObjectModel(
        name=name,
        noun=noun,
        shape=solid,
        extents=built.extents,
        solids=built.solids,
        mass=_density(name, solid, body, known) * sum(s.volume for s in built.solids),
        friction=np.array([known.unknown.friction if friction is None else friction, TORSION, ROLLING]),
        rolls=solid == "sphere",
        movable=True,
        container=built.inner_radius > 0,
        inner_floor=built.inner_floor,
        inner_radius=built.inner_radius,
        rgb=_colour(name, noun, known),
        handle=built.handle,
        visual=body.visual if body else None,
    )


def _bodies(catalogue: Catalogue) -> dict[str, ObjectEntry]:
    return {noun: entry for noun, entry in catalogue.objects.items() if entry.body is not None}


def _built(name: str, solid: Shape, body: BodyEntry | None, sizes: np.ndarray) -> Built:
    if body is not None and body.model is not None:
        return MODELS[body.model](name, sizes)
    if solid == "sphere":
        return _round(sizes)
    if solid == "cylinder":
        radius = (sizes[0] + sizes[1]) / 4
        sizes = np.array([2 * radius, 2 * radius, sizes[2]])
    return Built((SolidShape(solid, sizes / 2),), sizes)


def _round(sizes: np.ndarray) -> Built:
    """A sphere when the sizes differ by less than a tenth (perception's noise), else an ellipsoid."""
    if sizes.max() < 1.1 * sizes.min():
        sizes = np.full(3, sizes.mean())
        return Built((SolidShape("sphere", sizes / 2),), sizes)
    return Built((SolidShape("ellipsoid", sizes / 2),), sizes)


def _density(name: str, solid: Shape, body: BodyEntry | None, catalogue: Catalogue) -> float:
    """In [kg/m^3]."""
    if body is None:
        return catalogue.unknown.density
    if body.density is not None:
        return body.density
    assert body.mass is not None  # one of the two is given
    return body.mass / sum(s.volume for s in _built(name, solid, body, np.array(body.extents)).solids)


def _check(catalogue: Catalogue, noun: str, built: Built) -> None:
    """What an entry says of its model is true.

    Raises:
        ConfigError: It is not; names file and entry.
    """
    entry = catalogue.objects[noun]
    body = entry.body
    assert body is not None
    where, what = f"{catalogue.source}: objects.{noun}", body.model or f"a plain {entry.shape}"
    if (body.grasp == "handle") != (built.handle is not None):
        has, valid = ("a", "handle") if built.handle is not None else ("no", "body")
        raise ConfigError(f"{where}.body.grasp: {what} has {has} handle; say {valid}, or give another model")
    if (entry.carries == "inside") != (built.inner_radius > 0):
        has, valid = ("an", "inside") if built.inner_radius > 0 else ("no", "on_top, leave it out")
        raise ConfigError(f"{where}.carries: {what} has {has} inside; say {valid}, or give another model")


def _colour(name: str, noun: str | None, catalogue: Catalogue) -> tuple[float, float, float]:
    words, colours = name.split("_"), catalogue.colours
    # "orange" is a fruit when it is the noun.
    named = next((w for w in words if w in colours and not (w == noun and words.count(w) == 1)), None)
    if named is None and noun is not None:
        body = catalogue.objects[noun].body
        named = (body.paint if body else None) or catalogue.usual_colours(noun)[0]
    return catalogue.paints[named or catalogue.unknown.paint]
