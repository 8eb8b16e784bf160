"""What the tests of stops and speed overrides share: how far commanded positions are from a trajectory's own path."""

import numpy as np
from scipy.interpolate import make_interp_spline

from control.trajectory.playback import PROGRESS, Playback

NEAR = 40  # samples around a row's own progress in which its nearest point of the path is looked for


def distance_from_path(playback: Playback, first: int = 0) -> float:
    """Largest joint difference in [rad] of the rows from `first` on to the nearest points of their trajectory's curve.

    The curve is the quintic spline through the samples, which shares nothing with the playback's own interpolation.
    The nearest point is looked for around the row's progress, by projecting on the tangent a few times.
    """
    low = max(0, int(playback.clock[first, PROGRESS]) - NEAR)
    high = min(len(playback.trajectory.q), int(playback.clock[-1, PROGRESS]) + NEAR)
    curve = make_interp_spline(np.arange(low, high), playback.trajectory.q[low:high], k=5)
    tangent_of = curve.derivative()
    q, at = playback.q[first:], playback.clock[first:, PROGRESS].copy()
    own = at.copy()
    for _ in range(3):
        tangent = tangent_of(at)
        shift = np.sum((q - curve(at)) * tangent, axis=1) / np.maximum(np.sum(tangent**2, axis=1), 1e-18)
        at = np.clip(at + np.clip(shift, -1.0, 1.0), np.maximum(low, own - NEAR), np.minimum(high - 1, own + NEAR))
    nearest = np.minimum(np.abs(q - curve(at)).max(axis=1), np.abs(q - curve(own)).max(axis=1))
    return float(nearest.max())
