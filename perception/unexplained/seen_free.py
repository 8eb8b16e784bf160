"""Which points of space a camera saw to be free: its ray went through them to something farther."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from perception.geometry.prepared_frame import PreparedFrame

SPREADS = 3.0  # of depth noise by which what is seen must be farther
BEYOND = 0.01  # and this much more, in [m]


def seen_free(frames: Sequence[PreparedFrame], points: np.ndarray) -> NDArray[np.bool_]:
    """Whether at least one camera saw past each point, shape (n,).

    Args:
        frames: Of one moment.
        points: In the world in [m], shape (n, 3).
    """
    free = np.zeros(len(points), bool)
    for frame in frames:
        k, pose = frame.intrinsics, frame.world_T_camera
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        depth = local[:, 2]
        ahead = depth > 0.02
        safe = np.where(ahead, depth, 1.0)
        u = np.round(k.fx * local[:, 0] / safe + k.cx)
        v = np.round(k.fy * local[:, 1] / safe + k.cy)
        shown = np.flatnonzero(ahead & (u >= 0) & (v >= 0) & (u < k.width) & (v < k.height))
        row, column = v[shown].astype(int), u[shown].astype(int)
        needed = depth[shown] + BEYOND + SPREADS * frame.depth_std(1.0) * depth[shown] ** 2
        free[shown] |= frame.valid_depth[row, column] & (frame.depth[row, column] > needed)
    return free
