"""The surface that things stand on: where the table top really is in this frame."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SupportPlane:
    """A nearly horizontal plane z = height + slope · (x, y) in the world.

    Attributes:
        height: At the world's origin, in [m].
        slope: Rise along the world's x and y in [m/m], shape (2,).
        seen: False when the picture shows too little of a plane and z = 0 was assumed.
    """

    height: float
    slope: tuple[float, float]
    seen: bool

    def at(self, x: np.ndarray | float, y: np.ndarray | float) -> np.ndarray | float:
        """Height of the plane at (x, y), all in [m]."""
        return self.height + self.slope[0] * x + self.slope[1] * y


@dataclass(frozen=True)
class SupportSettings:
    """How the support is looked for.

    Attributes:
        band: Heights around the world's z = 0 that may be the table top, in [m].
        inlier: Half thickness of the plane for its last fit, in [m].
        max_slope: Steepest plane that is believed, in [m/m]; steeper ones are replaced by their height alone.
        min_share: Share of the points that must lie on the plane.
    """

    band: float = 0.06
    inlier: float = 0.012
    max_slope: float = 0.035
    min_share: float = 0.02


def estimate_support(points: np.ndarray, settings: SupportSettings | None = None) -> SupportPlane:
    """Fit the table top: the fullest height near z = 0, then least squares of z = h + a x + b y, trimmed twice.

    Gravity is the world's -z. When too little of the picture lies near z = 0 the plane z = 0 is assumed and says so.

    Args:
        points: Of a whole picture, thinned evenly, in the world in [m], shape (n, 3).
        settings: How it is looked for.
    """
    s = settings or SupportSettings()
    near = points[np.abs(points[:, 2]) < s.band]
    if len(near) < max(50, s.min_share * len(points)):
        return SupportPlane(0.0, (0.0, 0.0), False)
    counts, edges = np.histogram(near[:, 2], bins=np.arange(-s.band, s.band + 1e-9, 0.004))
    # Neighbouring bins share the noise of one plane.
    smooth = np.convolve(counts, np.ones(3), "same")
    peak = int(np.argmax(smooth))
    height = float((edges[peak] + edges[peak + 1]) / 2)
    plane = np.array([height, 0.0, 0.0])
    for thickness in (2.5 * s.inlier, 1.5 * s.inlier, s.inlier):
        predicted = plane[0] + near[:, :2] @ plane[1:]
        chosen = near[np.abs(near[:, 2] - predicted) < thickness]
        if len(chosen) < 50:
            return SupportPlane(height, (0.0, 0.0), True)
        design = np.c_[np.ones(len(chosen)), chosen[:, :2]]
        plane = np.linalg.lstsq(design, chosen[:, 2], rcond=None)[0]
    if np.hypot(plane[1], plane[2]) > s.max_slope:
        return SupportPlane(height, (0.0, 0.0), True)
    return SupportPlane(float(plane[0]), (float(plane[1]), float(plane[2])), True)
