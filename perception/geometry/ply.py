"""Coloured point clouds of frames with normals as PLY files, for viewers and surface reconstruction."""

from pathlib import Path

import numpy as np

from perception.errors import FrameError
from perception.frames import RgbdFrame
from perception.geometry.prepared_frame import PreparedFrame


def write_ply(frame: RgbdFrame, path: Path) -> int:
    """Write every pixel with known depth as a coloured point of the world, binary PLY through open3d.

    A point whose surface direction is not known has the normal (0, 0, 0).

    Args:
        frame: What to write.
        path: File to write; must end in .ply.

    Returns:
        Number of points written.

    Raises:
        FrameError: The file cannot be written.
    """
    import open3d

    frame = PreparedFrame.of(frame)
    known = frame.valid_depth
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(frame.points(known)))
    cloud.colors = open3d.utility.Vector3dVector(frame.colour[known] / 255.0)
    cloud.normals = open3d.utility.Vector3dVector(np.nan_to_num(frame.normals[known]))
    if not open3d.io.write_point_cloud(path, cloud):
        raise FrameError(
            f"cannot write the point cloud '{path}'; name a file that ends in .ply in a folder that exists"
        )
    return int(known.sum())
