"""Depth rays against hypotheses x = (x, y, yaw, fractions) of where one model stands and how far its parts are open.

A hypothesis is worth what it saves (`perception.known_shapes.ray_costs`) against the background alone: the support and
what was found before. So a door cannot hang in air that a camera looked through, and what hides the model costs
nothing.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.geometry.depth_rays import DepthRays
from perception.geometry.support import SupportPlane
from perception.known_shapes.fit_settings import KnownSettings
from perception.known_shapes.models import KnownModel
from perception.known_shapes.ray_casting import cast
from perception.known_shapes.ray_costs import ray_costs


@dataclass(frozen=True)
class Prediction:
    """How far rays would see, and what they would see.

    Attributes:
        distance: To the model in [m], infinite where it is not met, shape (n,).
        group: 0 for its fixed boards, i + 1 for its i-th part; shape (n,).
        normal: Of the face met in the world, shape (n, 3).
    """

    distance: NDArray[np.float64]
    group: NDArray[np.int64]
    normal: NDArray[np.float64]


class RayScene:
    """Rays against hypotheses x = (x, y, yaw, fractions) of one model."""

    def __init__(
        self,
        rays: DepthRays,
        background: np.ndarray,
        table: SupportPlane,
        model: KnownModel,
        settings: KnownSettings,
        shared: float,
    ) -> None:
        """Put rays and a model together.

        Args:
            rays: Of pictures of one moment.
            background: How far they see without the model in [m], shape (n,).
            table: What the model stands on.
            model: Whose place and fractions are looked for.
            settings: Of the fit.
            shared: How much of an independent sample one ray is, 0..1: neighbours share their error.
        """
        self.rays, self.background, self.table, self.model, self.settings = rays, background, table, model, settings
        self.shared = shared
        self.std = np.hypot(rays.std, settings.model_std)
        self.empty = ray_costs(rays.distance, background, self.std)

    def thinned(self, every: int) -> "RayScene":
        """The same with every n-th ray."""
        few = slice(None, None, every)
        return RayScene(self.rays.only(few), self.background[few], self.table, self.model, self.settings, self.shared)

    def with_settings(self, settings: KnownSettings) -> "RayScene":
        """The same judged by other settings."""
        return RayScene(self.rays, self.background, self.table, self.model, settings, self.shared)

    def pose(self, x: np.ndarray) -> np.ndarray:
        """world_T_model, shape (4, 4)."""
        return self.model.standing(x[0], x[1], x[2], float(self.table.at(x[0], x[1])))

    def _part_of(self, x: np.ndarray) -> "RayScene":
        """The same with those rays only that can meet the model at x, wherever its parts are."""
        near = self.rays.near(self.pose(x)[:3, 3], self.model.reach + 0.05)
        part = object.__new__(RayScene)
        part.table, part.model, part.settings, part.shared = self.table, self.model, self.settings, self.shared
        part.rays, part.std = self.rays.only(near), self.std[near]
        part.background, part.empty = self.background[near], self.empty[near]
        return part

    def predict(self, x: np.ndarray, only: int | None = None) -> Prediction:
        """What the rays would meet of the model; of one group only if asked."""
        pose = self.pose(x)
        n = len(self.rays)
        distance, group = np.full(n, np.inf), np.zeros(n, int)
        normal = np.zeros((n, 3))
        for i, (frame, boxes) in enumerate(self.model.groups(x[3:])):
            if only is not None and i != only:
                continue
            world_T_frame = pose @ frame
            hits = cast(self.rays, world_T_frame, boxes)
            closer = hits.distance < distance
            distance[closer], group[closer] = hits.distance[closer], i
            normal[closer] = hits.normal[closer] @ world_T_frame[:3, :3].T
        return Prediction(distance, group, normal)

    def worth(self, x: np.ndarray) -> float:
        """What the hypothesis saves against an empty support; the lower the better."""
        near = self._part_of(x)
        return near._saved(near.predict(x).distance)

    def _saved(self, distance: np.ndarray) -> float:
        expected = np.minimum(distance, self.background)
        return float((ray_costs(self.rays.distance, expected, self.std) - self.empty).sum())

    def opened(self, x: np.ndarray, fine: bool = False) -> np.ndarray:
        """The same place with each joint at its best fraction, one joint after the other, twice.

        Args:
            x: The hypothesis.
            fine: Look only near the fractions of x, in small steps, and at a few far from it.
        """
        near = self._part_of(x)
        x = x.copy()
        n = self.settings.fractions
        for sweep in range(2 if len(self.model.parts) > 1 else 1):
            for i in range(len(self.model.parts)):
                rest = np.full(len(near.rays), np.inf)
                for group in range(len(self.model.parts) + 1):
                    # In the first sweep the parts not yet looked at are left out: they are not known to be anywhere.
                    if group != i + 1 and (sweep or fine or group <= i):
                        rest = np.minimum(rest, near.predict(x, group).distance)
                tried = np.linspace(0.0, 1.0, n)
                if fine:
                    tried = np.r_[tried, np.clip(x[3 + i] + np.linspace(-1.0, 1.0, n) / n, 0.0, 1.0)]
                costs = []
                for fraction in tried:
                    x[3 + i] = fraction
                    costs.append(near._saved(np.minimum(rest, near.predict(x, i + 1).distance)))
                x[3 + i] = tried[int(np.argmin(costs))]
        return x

    def settle(self, x: np.ndarray, rounds: int, keep: bool = True) -> np.ndarray:
        """Damped point-to-plane steps from x; the better of both ends, or the last one if not `keep`."""
        near = self._part_of(x)
        first, gate = x.copy(), 0.05
        for _ in range(rounds):
            jacobian, off, weight = near._linear(x, gate)
            normal = (jacobian * weight[:, None]).T @ jacobian + np.diag(self._prior())
            step = _bounded_step(normal, (jacobian * weight[:, None]).T @ off, x)
            step = np.clip(step, -self._longest(), self._longest())
            x = x + step
            x[3:] = np.clip(x[3:], 0.0, 1.0)
            gate = max(0.6 * gate, 0.012)
            if np.all(np.abs(step) < 1e-4):
                break
        return x if not keep or near.worth(x) <= near.worth(first) else first

    def shifted(self, x: np.ndarray) -> np.ndarray:
        """Shift and turn x by what rays past its edges say, if its faces do not tell where it is.

        Faces hold a flat thing along their normals only; that rays end on it or pass it holds the rest.
        """
        near = self._part_of(x)
        if near.covariance(x)[[0, 1], [0, 1]].max() < self.settings.edges_from**2:
            return x
        best, size = near.worth(x), np.array([0.012, 0.012, 0.1])
        while size[0] > 0.001:
            better = False
            for way in np.vstack([np.diag(size), -np.diag(size)]):
                tried = x + np.array([*way, *np.zeros(len(self.model.parts))])
                worth = near.worth(tried)
                if worth < best:
                    x, best, better = tried, worth, True
            if not better:
                size = size / 2.0
        return x

    def covariance(self, x: np.ndarray) -> np.ndarray:
        """Of x, as far as the faces that are seen tell it, shape (len(x), len(x))."""
        jacobian, _, weight = self._linear(x, 0.012)
        return np.linalg.inv((jacobian * weight[:, None]).T @ jacobian + np.diag(self._prior()))

    def _longest(self) -> np.ndarray:
        return np.array([0.03, 0.03, 0.12, *np.full(len(self.model.parts), 0.1)])

    def _prior(self) -> np.ndarray:
        s = self.settings
        std = np.array([s.position_prior, s.position_prior, s.yaw_prior])
        return np.array([*std, *np.full(len(self.model.parts), s.fraction_prior)]) ** -2.0

    def _linear(self, x: np.ndarray, gate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Point-to-plane residuals linearised at x.

        With p measured, q and n point and normal of the face that its ray meets, off = n · (p - q) = J dx, where a
        point of the model moves along x and y by dx, about the frame's z by yaw, and with its part.

        Returns:
            J of shape (m, len(x)), off in [m] and weights of shape (m,).
        """
        seen = self.predict(x)
        # Parallel to the face, an error along the ray moves a point within it.
        along = np.abs(np.einsum("ij,ij->i", seen.normal, self.rays.direction))
        off_ray = self.rays.distance - seen.distance
        used = (np.abs(off_ray) < gate + 3.0 * self.std) & (along > 0.1)
        used &= seen.distance < self.background
        normal, points = seen.normal[used], self.rays.points[used]
        distance = seen.distance[used]
        q = self.rays.origin[used] + distance[:, None] * self.rays.direction[used]
        off = np.einsum("ij,ij->i", normal, points - q)
        pose = self.pose(x)
        arm = q - pose[:3, 3]
        columns = [normal[:, 0], normal[:, 1], normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]]
        for i, part in enumerate(self.model.parts):
            axis = pose[:3, :3] @ part.axis
            if part.kind == "slide":
                way = np.broadcast_to(axis, q.shape)
            else:
                way = np.cross(axis, q - (pose[:3, :3] @ part.anchor + pose[:3, 3]))
            columns.append(part.opened * np.einsum("ij,ij->i", normal, way) * (seen.group[used] == i + 1))
        std = np.hypot(self.rays.std[used] * along[used], self.settings.model_std)
        weight = self.shared / (std**2 * (1.0 + (off / (2.0 * std)) ** 2))
        return np.stack(columns, -1), off, weight


def _bounded_step(normal: np.ndarray, gradient: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Solution of normal · step = gradient; what leaves the fractions' range 0..1 stops there and the rest adapts."""
    step = np.linalg.solve(normal, gradient)
    stopped = np.zeros(len(x), bool)
    for _ in range(len(x) - 3):
        beyond = ~stopped & (np.arange(len(x)) >= 3) & ((x + step < 0.0) | (x + step > 1.0))
        if not beyond.any():
            break
        step[beyond] = np.clip(x[beyond] + step[beyond], 0.0, 1.0) - x[beyond]
        stopped |= beyond
        free = ~stopped
        step[free] = np.linalg.solve(
            normal[np.ix_(free, free)], gradient[free] - normal[np.ix_(free, stopped)] @ step[stopped]
        )
    return step
