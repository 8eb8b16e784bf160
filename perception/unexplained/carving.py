"""Which space the depth of a look shows to be free: every voxel's centre held against the depth behind its pixel.

With z the distance of the centre along a camera's axis, d the depth of its pixel, d' the least depth of the
`POOL` x `POOL` pixels around it, and m = max(half a voxel's diagonal, 3 sigma_z(d)):

    free       z < d' - m
    a surface  |z - d| <= m
    not seen   everything else: behind a surface, outside the picture, or where too little depth is known

The least depth of a patch keeps a voxel from counting as free whose middle is passed by rays that miss what is in it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from perception.estimates import ObjectEstimate
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.geometry.prepared_frame import PreparedFrame
from perception.seen_space import FREE, OCCUPIED, UNSEEN, SeenSpace
from perception.unexplained.regions import PlacedSolid

POOL = 8  # [px]: 11 mm at 0.8 m through a lens of 575 px
LEAST_KNOWN = 0.5  # share of a patch's pixels whose depth has to be known
NEAREST = 0.05  # [m] from a camera before which nothing is seen
SIGMAS = 3.0


def look_into(space: SeenSpace, frames: Sequence[RgbdFrame]) -> SeenSpace:
    """The box with what some frames show of it.

    Args:
        space: What was known of an unchanged world before; `SeenSpace.unseen` for nothing.
        frames: Of one moment; those without any depth show nothing.
    """
    state = space.state.copy()
    for frame in frames:
        if frame.valid_depth.any():
            np.maximum(state, _seen_by(space, PreparedFrame.of(frame)), out=state)
    return replace(space, state=state)


def filled(space: SeenSpace, solids: Sequence[PlacedSolid], state: int, within: float = 0.0) -> SeenSpace:
    """The box with all voxels in another state whose centres lie in some solids.

    Args:
        space: Not changed.
        solids: In the world.
        state: `FREE` for what may move away by itself (the robot), `OCCUPIED` for what stands there.
        within: Distance in [m] up to which a centre outside of a solid counts as in it.
    """
    out = space.state.copy()
    x, y, z = space.centres()
    for solid in solids:
        reach = np.abs(solid.pose[:3, :3]) @ _box_half(solid) + within
        first = np.floor((solid.pose[:3, 3] - reach - space.low) / space.step).astype(int)
        last = np.ceil((solid.pose[:3, 3] + reach - space.low) / space.step).astype(int)
        i, j, k = (slice(max(0, a), max(0, b)) for a, b in zip(first, last, strict=True))
        block = out[i, j, k]
        if block.size:
            points = np.stack(np.meshgrid(x[i], y[j], z[k], indexing="ij"), -1).reshape(-1, 3)
            block[(solid.distance(points) <= within).reshape(block.shape)] = state
    return replace(space, state=out)


def estimate_solids(objects: Iterable[ObjectEstimate]) -> tuple[PlacedSolid, ...]:
    """The solids that perceived things were fitted by, where they stand."""
    return tuple(PlacedSolid(o.shape, np.asarray(o.extents) / 2, o.world_T_object) for o in objects)


def below(space: SeenSpace, height: float) -> SeenSpace:
    """The box with everything filled whose centre is not above a height in [m]: a table is no space."""
    out = space.state.copy()
    out[:, :, space.centres()[2] <= height] = OCCUPIED
    return replace(space, state=out)


def _box_half(solid: PlacedSolid) -> np.ndarray:
    return solid.half + np.array([0.0, 0.0, solid.half[0] if solid.kind == "capsule" else 0.0])


def _seen_by(space: SeenSpace, frame: PreparedFrame) -> NDArray[np.int8]:
    """State of every voxel as one camera shows it, shape (nx, ny, nz)."""
    lens = frame.intrinsics
    camera_T_world = np.linalg.inv(frame.world_T_camera).astype(np.float32)
    turn, shift = camera_T_world[:3, :3], camera_T_world[:3, 3]
    x, y, z = space.centres()
    # Each coordinate in the camera's frame is a sum over the axes, so no list of points is made.
    right, down, ahead = (
        (shift[a] + turn[a, 0] * x)[:, None, None] + (turn[a, 1] * y)[:, None] + turn[a, 2] * z for a in range(3)
    )
    state = np.zeros(space.state.shape, np.int8)
    front = ahead > NEAREST
    u, v = _pixels(right, down, ahead, front, lens)
    inside = front & (u >= 0) & (u < lens.width) & (v >= 0) & (v < lens.height)
    at, u, v = np.flatnonzero(inside), u[inside], v[inside]
    ahead = ahead[inside]
    here, least = frame.known_depth[v, u], _least(frame.known_depth)[v // POOL, u // POOL]
    margin = np.maximum(
        np.float32(space.step * np.sqrt(3.0) / 2), np.float32(SIGMAS * frame.depth_std(1.0)) * here * here
    )
    found = np.full(len(at), UNSEEN, np.int8)
    found[ahead < least - margin] = FREE
    found[np.abs(ahead - here) <= margin] = OCCUPIED
    state.reshape(-1)[at] = found
    return state


def _pixels(
    right: np.ndarray, down: np.ndarray, ahead: np.ndarray, front: np.ndarray, lens: CameraIntrinsics
) -> tuple[np.ndarray, np.ndarray]:
    """Column and row of the pixel that each centre falls on, int32; anywhere where it is not in front."""
    scale = np.divide(np.float32(1.0), ahead, out=np.full_like(ahead, -1e6), where=front)
    u = np.rint(np.float32(lens.fx) * right * scale + np.float32(lens.cx))
    v = np.rint(np.float32(lens.fy) * down * scale + np.float32(lens.cy))
    most = np.float32(1e6)
    return np.clip(u, -most, most).astype(np.int32), np.clip(v, -most, most).astype(np.int32)


def _least(depth: np.ndarray) -> NDArray[np.float32]:
    """Least known depth of each patch in [m]; -inf where too little of it is known."""
    rows, columns = -(-depth.shape[0] // POOL), -(-depth.shape[1] // POOL)
    padded = np.full((rows * POOL, columns * POOL), np.nan, np.float32)
    padded[: depth.shape[0], : depth.shape[1]] = depth
    patches = padded.reshape(rows, POOL, columns, POOL)
    known = np.isfinite(patches)
    least = np.where(known, patches, np.float32(np.inf)).min(axis=(1, 3))
    return np.where(known.mean(axis=(1, 3)) >= LEAST_KNOWN, least, np.float32(-np.inf))
