"""Joint splines through points that are evenly spaced in time, as matrices from points to samples.

Cubic: on an interval of length h between points p_k and p_{k+1}, with u in 0..1,

    q(u) = (2u^3 - 3u^2 + 1) p_k + (u^3 - 2u^2 + u) h m_k + (-2u^3 + 3u^2) p_{k+1} + (u^3 - u^2) h m_{k+1}

with slopes from finite differences, m_k = (p_{k+1} - p_{k-1}) / 2h, at the last point one-sided and at the first as
given: so that motions which replace one another agree in position and speed. Source: Howell et al., "Predictive
Sampling: Real-time Behaviour Synthesis with MuJoCo", 2022, section 3 (cubic Hermite splines). Its splines of order
zero jump, which no joint path can, so they are not offered.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

SplineOrder = Literal["linear", "cubic"]


@dataclass(frozen=True)
class SplineBasis:
    """Weights of K points, and of the speed at the first, for T samples.

    Attributes:
        values: Positions = values @ [p_0 .. p_{K-1}, v_0], shape (T, K + 1).
        slopes: Speeds in [1/s] of the same, shape (T, K + 1).
    """

    values: NDArray[np.float64]
    slopes: NDArray[np.float64]

    @classmethod
    def of(cls, order: SplineOrder, points: int, horizon: float, times: np.ndarray) -> "SplineBasis":
        """Weights for a spline.

        Args:
            order: "linear" ignores the speed at the first point.
            points: Number of points K >= 2, the first at time 0, the last at the horizon.
            horizon: Time of the last point in [s].
            times: Times of the samples in [s], shape (T,); the spline holds its last point beyond the horizon.
        """
        step = horizon / (points - 1)
        at = np.clip(times, 0.0, horizon)
        k = np.minimum((at / step).astype(int), points - 2)
        u = at / step - k
        points_of = np.eye(points, points + 1)  # row k picks p_k out of [p_0 .. p_{K-1}, v_0]
        start, end = points_of[k], points_of[k + 1]
        if order == "linear":
            values, slopes = start + u[:, None] * (end - start), (end - start) / step
        else:
            tangents = np.empty_like(points_of)  # h m_k
            tangents[1:-1] = (points_of[2:] - points_of[:-2]) / 2
            tangents[-1] = points_of[-1] - points_of[-2]
            tangents[0] = step * np.eye(points + 1)[-1]
            out_of, into = tangents[k], tangents[k + 1]
            u = u[:, None]
            values = (
                (2 * u**3 - 3 * u**2 + 1) * start
                + (u**3 - 2 * u**2 + u) * out_of
                + (3 * u**2 - 2 * u**3) * end
                + (u**3 - u**2) * into
            )
            slopes = (
                (6 * u**2 - 6 * u) * (start - end) + (3 * u**2 - 4 * u + 1) * out_of + (3 * u**2 - 2 * u) * into
            ) / step
        slopes = np.where((times > horizon)[:, None], 0.0, slopes)
        return cls(values, slopes)

    def sample(self, points: np.ndarray, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions and speeds of splines.

        Args:
            points: Shape (..., K, d).
            speed: At the first point in [1/s], shape (d,).

        Returns:
            Positions and speeds in [1/s], both of shape (..., T, d).
        """
        first = np.broadcast_to(speed, (*points.shape[:-2], 1, points.shape[-1]))
        given = np.concatenate([points, first], axis=-2)
        return self.values @ given, self.slopes @ given
