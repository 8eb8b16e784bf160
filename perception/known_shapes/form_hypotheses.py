"""Hypotheses x = (x, y, yaw, logarithms of sizes over usual ones) of a form: against points, and against rays.

Points p_i with rays d_i pull the form's surface, with signed distance f and normal n:

    sum_i rho(f(p_i)^2 / ((n · d_i)^2 s_i^2 + s_0^2)) + sum_k (log(size_k / usual size_k) / s_size)^2

because depth errs along the ray only. Rays are followed along the form's distance until they meet it.
"""

from collections.abc import Sequence

import numpy as np

from perception.geometry.depth_rays import DepthRays
from perception.known_shapes.fit_settings import FormSettings
from perception.known_shapes.forms import FormSolid, KnownForm

STEP, SHARE = 1e-4, 1e-3  # for slopes: of a point in [m], of a size's logarithm


def nearest_distance(solids: Sequence[FormSolid], points: np.ndarray) -> np.ndarray:
    """Signed distance of points to the nearest of some solids in [m], shape (n,)."""
    nearest = solids[0].distance(points)
    for solid in solids[1:]:
        np.minimum(nearest, solid.distance(points), out=nearest)
    return nearest


def form_pose(form: KnownForm, x: np.ndarray, bottom: float) -> np.ndarray:
    """world_T_form of a hypothesis x that stands at a height `bottom` [m], shape (4, 4)."""
    pose = np.eye(4)
    c, s = np.cos(x[2]), np.sin(x[2])
    pose[:2, :2] = [[c, -s], [s, c]]
    pose[:3, 3] = x[0], x[1], bottom + form.extents[2] * np.exp(x[5]) / 2
    return pose


class FormProblem:
    """Points against hypotheses x = (x, y, yaw, log sizes) of one form that stands at a height."""

    def __init__(self, rays: DepthRays, form: KnownForm, bottom: float, settings: FormSettings) -> None:
        self.rays, self.form, self.bottom, self.settings = rays, form, bottom, settings
        self.points = rays.points

    def thinned(self, every: int) -> "FormProblem":
        """The same with every n-th point."""
        return FormProblem(self.rays.only(slice(None, None, every)), self.form, self.bottom, self.settings)

    def linear(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Signed distances of the points to the form's surface in [m], their slopes by x and spreads across it.

        With the local point q and the distance's gradient g there, a shift of the form by e changes it by -g · e, and
        a turn about z by g · (q_y, -q_x, 0).

        Returns:
            Shapes (n,), (n, 6) and (n,).
        """
        pose, sizes = form_pose(self.form, x, self.bottom), self.form.extents * np.exp(x[3:])
        local = (self.points - pose[:3, 3]) @ pose[:3, :3]
        solids = self.form.build(sizes)
        off = nearest_distance(solids, local)
        gradient = np.stack([(nearest_distance(solids, local + STEP * e) - off) / STEP for e in np.eye(3)], -1)
        slopes = np.empty((len(off), 6))
        slopes[:, :2] = -gradient @ pose[:2, :3].T
        slopes[:, 2] = gradient[:, 0] * local[:, 1] - gradient[:, 1] * local[:, 0]
        for k in range(3):
            grown = sizes.copy()
            grown[k] *= np.exp(SHARE)
            # A taller one stands as low as before: its middle is higher.
            moved = local - [0.0, 0.0, (grown[2] - sizes[2]) / 2]
            slopes[:, 3 + k] = (nearest_distance(self.form.build(grown), moved) - off) / SHARE
        # The distance grows along a ray by the cosine between the ray and the surface's normal.
        along = np.einsum("ij,ij->i", gradient, self.rays.direction @ pose[:3, :3])
        return off, slopes, np.hypot(self.rays.std * along, self.settings.model_std)

    def settle(self, x: np.ndarray, rounds: int = 25) -> tuple[float, np.ndarray]:
        """Damped Gauss-Newton from x with the weights 1 / (1 + (r / 2)^2); the cost reached and its x."""
        damping, best, at = 1e-2, np.inf, x
        kept = off, slopes, std = self.linear(x)
        for _ in range(rounds):
            cost = self._cost(off, std, x)
            if cost < best:
                best, at, damping = cost, x, max(damping / 4.0, 1e-5)
                kept = off, slopes, std
            else:
                damping *= 6.0
                off, slopes, std = kept
                if damping > 1e3:
                    break
            normal, gradient = self._normal(off, slopes, std, at)
            step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
            step = np.clip(step, [-0.02, -0.02, -0.3, -0.1, -0.1, -0.1], [0.02, 0.02, 0.3, 0.1, 0.1, 0.1])
            if np.all(np.abs(step) < [1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 1e-3]):
                break
            x = at + step
            x[3:] = np.clip(x[3:], -0.5, 0.5)
            off, slopes, std = self.linear(x)
        return best, at

    def _normal(self, off, slopes, std, x) -> tuple[np.ndarray, np.ndarray]:
        weight = self._shared() / (std**2 * (1.0 + (off / (2.0 * std)) ** 2))
        prior = np.array([0.0, 0.0, 0.0, *np.full(3, self.settings.size_std**-2.0)])
        normal = (slopes * weight[:, None]).T @ slopes + np.diag(prior + 1e-9)
        return normal, (slopes * weight[:, None]).T @ off + prior * x

    def _cost(self, off: np.ndarray, std: np.ndarray, x: np.ndarray) -> float:
        robust = 4.0 * np.log1p((off / (2.0 * std)) ** 2)
        return float(self._shared() * robust.sum() + np.sum((x[3:] / self.settings.size_std) ** 2))

    def _shared(self) -> float:
        """How many independent samples one point is, as neighbours share their error; points are thinned already."""
        return 0.3

    def covariance(self, x: np.ndarray) -> np.ndarray:
        """Of x, shape (6, 6)."""
        normal, _ = self._normal(*self.linear(x), x)
        return np.linalg.inv(normal)


def followed(rays: DepthRays, form: KnownForm, x: np.ndarray, bottom: float, steps: int = 24) -> np.ndarray:
    """How far rays see until they meet the form in [m], infinite where they miss it, shape (n,): sphere tracing."""
    pose = form_pose(form, x, bottom)
    sizes = form.extents * np.exp(x[3:])
    solids = form.build(sizes)
    origin = (rays.origin - pose[:3, 3]) @ pose[:3, :3]
    direction = rays.direction @ pose[:3, :3]
    # Only what passes the ball around it, from where it enters the ball on.
    middle = -np.einsum("ij,ij->i", origin, direction)
    across = np.einsum("ij,ij->i", origin, origin) - middle**2
    radius = 0.5 * float(np.linalg.norm(sizes)) + 0.01
    passing = np.flatnonzero((across < radius**2) & (middle > 0.0))
    found = np.full(len(rays), np.inf)
    if not len(passing):
        return found
    half = np.sqrt(radius**2 - across[passing])
    t, last = middle[passing] - half, middle[passing] + half
    origin, direction = origin[passing], direction[passing]
    active = np.arange(len(passing))
    met = np.zeros(len(passing), bool)
    for _ in range(steps):
        points = origin[active] + t[active, None] * direction[active]
        gap = nearest_distance(solids, points)
        met[active[gap < 5e-4]] = True
        t[active] += np.maximum(gap, 0.0)
        active = active[(gap >= 5e-4) & (t[active] < last[active])]
        if not len(active):
            break
    found[passing[met]] = t[met]
    return found
