"""What a cell file says about the truth of a simulated cell: what there is, where, what is locked, how cameras err.

Nothing but the simulated cell and its scorers may read it.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated

from pydantic import Field, model_validator

from sim_check.cells.furniture_config import Colour, FurnitureConfig, LeverConfig, WeightPlateConfig
from sim_check.strict_config import Fraction, Name, NotNegative, Positive, Strict, Vector2


class PlacementConfig(Strict):
    """Where the simulated cell puts one object or piece of furniture at the start.

    Attributes:
        object: Name, from the cell's objects or its furniture.
        position: Centre of its range: in the world in [m] for the table; in the frame of what it stands on, lies in or
            lies behind otherwise. Of furniture: of the middle of its box.
        spread: Half widths of its range in [m], uniform.
        yaw_deg: Centre of its yaw in [degrees]. Furniture with yaw 0 faces -x, where the robot is.
        yaw_spread_deg: Half width of the yaw's range in [degrees], uniform; 180 for objects and 0 for furniture when
            left out.
        extents: Its full sizes in [m]; the library's usual ones if left out. Not for furniture.
        size_spread: Half width of a common factor on its sizes, uniform: 0.04 makes sizes 0.96 to 1.04 of the nominal.
        mass: In [kg]; follows from size and material if left out. Not for furniture.
        colours: Colours to draw from, for things that are not named by their colour.
        stands_on: Object or furniture that it stands on, instead of the table; placed earlier in the list.
        lies_in: Container or furniture with an inside that it lies in; placed earlier in the list. In furniture,
            `position` is given from the middle of the inside.
        lies_behind_handles_of: Furniture with doors, on whose handles' lower stand-offs it lies, between the doors and
            the bars; `position` is given from the middle of the slot, and a yaw of 0 lies along the doors.
        joints: How far joints of furniture are open at the start, 0 closed .. 1 open.
        joint_spread: Half width of the range of those fractions, uniform; closed joints stay closed.
        only_if: Option of the cell that must be on for the object to be there.
    """

    object: Name
    position: Vector2 = (0.0, 0.0)
    spread: tuple[NotNegative, NotNegative] = (0.0, 0.0)
    yaw_deg: float = 0.0
    yaw_spread_deg: NotNegative | None = None
    extents: tuple[Positive, Positive, Positive] | None = None
    size_spread: Annotated[float, Field(ge=0, lt=0.5)] = 0.0
    mass: Positive | None = None
    colours: tuple[Colour, ...] = ()
    stands_on: Name | None = None
    lies_in: Name | None = None
    lies_behind_handles_of: Name | None = None
    joints: dict[Name, Fraction] = Field(default_factory=dict)
    joint_spread: Annotated[float, Field(ge=0, lt=0.5)] = 0.0
    only_if: Name | None = None

    @property
    def support(self) -> str | None:
        """What carries it, or None for the table."""
        return self.stands_on or self.lies_in or self.lies_behind_handles_of

    @model_validator(mode="after")
    def _one_support(self) -> "PlacementConfig":
        supports = (self.stands_on, self.lies_in, self.lies_behind_handles_of)
        if sum(s is not None for s in supports) > 1:
            raise ValueError(
                "give either stands_on or lies_in or lies_behind_handles_of, or none of them for the table"
            )
        return self


class LockConfig(Strict):
    """A bolt inside furniture that keeps a door closed, drawn by a lever or a weight plate somewhere else.

    Attributes:
        joints: Doors that it keeps closed, one bolt each.
        drawn_by: Joint of a lever (`NAME_rod`) or of a weight plate (`NAME_plate`) that draws the bolts.
        free_at: Share of that joint's way at which the doors come free.
    """

    joints: Annotated[tuple[Name, ...], Field(min_length=1)]
    drawn_by: Name
    free_at: Annotated[float, Field(ge=0.3, le=0.95)] = 0.8


class DepthNoiseConfig(Strict):
    """Stereo noise of the simulated cameras; the formula stands in `sim_check.world.depth_noise`.

    Attributes:
        baseline: Distance between the two lenses in [m]; 63 mm is a ZED Mini's.
        disparity_std_px: Root mean square of the disparity's error in [px].
        correlation_px: Width of the matching window that correlates neighbouring errors (Gaussian sigma) in [px].
        step_px: Disparity is rounded to multiples of this in [px].
        edge_disparity_px: A difference within the window that counts as a depth edge, in [px].
        flying_share, edge_dropout_share: Shares of the edge pixels that mix both sides, and that are lost, 0..1.
        blob_share: Share of all pixels lost in blobs where nothing could be matched, 0..1.
        nearest, farthest: Range of depths that can be matched in [m].
    """

    baseline: Positive = 0.063
    disparity_std_px: NotNegative = 0.25
    correlation_px: Positive = 3.0
    step_px: NotNegative = 0.0625
    edge_disparity_px: Positive = 1.5
    flying_share: Annotated[float, Field(ge=0, le=1)] = 0.3
    edge_dropout_share: Annotated[float, Field(ge=0, le=1)] = 0.25
    blob_share: Annotated[float, Field(ge=0, le=0.5)] = 0.014
    nearest: Positive = 0.15
    farthest: Positive = 8.0

    @model_validator(mode="after")
    def _consistent(self) -> "DepthNoiseConfig":
        if self.nearest >= self.farthest:
            raise ValueError("nearest must be below farthest")
        if self.flying_share + self.edge_dropout_share > 1:
            raise ValueError("flying_share and edge_dropout_share cannot add up to more than 1")
        return self


class SimulationConfig(Strict):
    """The truth of a simulated cell; nothing but the simulated cell and its scorers may read it.

    Attributes:
        placements: What there is, and where.
        locks: What keeps doors closed.
        gap: Least distance between the outlines (circles around footprints) of things on the table in [m].
        mass_mismatch, friction_mismatch: Half widths of seeded factors on the library's masses and friction.
        depth_noise: Stereo noise, or null for perfect depth.
    """

    placements: tuple[PlacementConfig, ...] = ()
    locks: tuple[LockConfig, ...] = ()
    gap: NotNegative = 0.04
    mass_mismatch: Annotated[float, Field(ge=0, lt=1)] = 0.1
    friction_mismatch: Annotated[float, Field(ge=0, lt=1)] = 0.1
    depth_noise: DepthNoiseConfig | None = DepthNoiseConfig()


def check_simulation(
    simulation: SimulationConfig,
    objects: Sequence[str],
    furniture: Mapping[str, FurnitureConfig],
    options: Mapping[str, bool],
) -> None:
    """Raise ValueError when a placement or a lock speaks of something that the cell does not have."""
    seen: list[str] = []
    for p in simulation.placements:
        if p.object not in objects and p.object not in furniture:
            raise ValueError(
                f"placement of '{p.object}': objects are {sorted(objects)}, furniture is {sorted(furniture)}"
            )
        if p.object in seen:
            raise ValueError(f"'{p.object}' is placed twice")
        if p.support is not None and p.support not in seen:
            raise ValueError(f"'{p.object}' is placed on or in '{p.support}', which must be placed before it")
        if p.only_if is not None and p.only_if not in options:
            raise ValueError(f"only_if of '{p.object}': options are {sorted(options)}, not '{p.only_if}'")
        _check_furniture_placement(p, furniture)
        seen.append(p.object)
    doors, drivers = [], []
    for name in (n for n in seen if n in furniture):
        draws = isinstance(furniture[name], LeverConfig | WeightPlateConfig)
        (drivers if draws else doors).extend(furniture[name].part_names(name))
    for lock in simulation.locks:
        for name in lock.joints:
            if name not in doors:
                raise ValueError(f"a lock keeps doors closed, not '{name}'; doors that are placed: {doors}")
        if lock.drawn_by not in drivers:
            raise ValueError(
                f"a lock is drawn by a lever or a weight plate, not by '{lock.drawn_by}'; there are {drivers}"
            )


def _check_furniture_placement(p: PlacementConfig, furniture: Mapping[str, FurnitureConfig]) -> None:
    if p.object in furniture:
        if p.support is not None:
            raise ValueError(f"furniture '{p.object}' stands on the table; leave out what it stands on or lies in")
        for key in ("extents", "mass"):
            if getattr(p, key) is not None:
                raise ValueError(f"{key} of furniture '{p.object}' is not set here; its sizes are, under `furniture`")
        names = list(furniture[p.object].part_names(p.object))
        for joint in p.joints:
            if joint not in names:
                raise ValueError(f"'{p.object}' has no joint '{joint}'; it has {names}")
        return
    if p.joints:
        raise ValueError(f"'{p.object}' is no furniture and has no joints")
    if p.lies_behind_handles_of is not None and p.lies_behind_handles_of not in furniture:
        raise ValueError(f"'{p.object}' lies behind the handles of '{p.lies_behind_handles_of}', which is no furniture")
