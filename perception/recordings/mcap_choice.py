"""What to read out of an MCAP file. Needs the standard library only."""

from dataclasses import dataclass


@dataclass(frozen=True)
class McapChoice:
    """What to read out of an MCAP file; the defaults find it."""

    colour: str | None = None
    """MCAP: topic of colour pictures, where several could be meant."""
    depth: str | None = None
    """MCAP: topic of depth pictures registered to them."""
    info: str | None = None
    """MCAP: topic of their CameraInfo."""
    cameras: tuple[str, ...] = ()
    """Names of the cameras to read, as the notes of a recording name them; empty for all."""
    world: str | None = None
    """MCAP: frame of the transforms that poses are given in; default: world, map or the robot's base."""
    tolerance: float = 0.02
    """MCAP: by how much the stamps of colour and depth of one frame may differ, in [s]."""
