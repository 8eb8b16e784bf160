"""One object seen by several cameras is one object: estimates merged by the weight of their spread."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from perception.estimates import ObjectEstimate

BY_CHANCE = 2.0  # two right values have a larger ratio in one of six cases


def agree(a: ObjectEstimate, b: ObjectEstimate, gate: float = 0.03) -> bool:
    """Whether two estimates may be one object: centres within `gate` [m] and three spreads of each other."""
    allowed = gate + 3.0 * np.hypot(np.linalg.norm(a.position_std), np.linalg.norm(b.position_std))
    return bool(np.linalg.norm(a.position - b.position) <= allowed)


def turned_like(estimate: ObjectEstimate, yaw: float) -> ObjectEstimate:
    """The same thing with the yaw nearest to `yaw` [rad] among its four quarter turns, sides swapped to fit.

    A thing whose yaw has no meaning comes back as it is.
    """
    if not np.isfinite(estimate.yaw_std):
        return estimate
    quarters = round((yaw - estimate.yaw) / (np.pi / 2))
    if quarters % 4 == 0:
        return estimate
    angle = quarters * np.pi / 2
    c, s = np.round(np.cos(angle)), np.round(np.sin(angle))
    pose = estimate.world_T_object.copy()
    pose[:3, :3] = pose[:3, :3] @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    x, y, z = estimate.extents
    extents = np.array([y, x, z]) if quarters % 2 else estimate.extents
    sizes = estimate.extents_std
    if sizes is not None and quarters % 2:
        sizes = sizes[[1, 0, 2]]
    return replace(estimate, world_T_object=pose, extents=extents, extents_std=sizes)


def merge(estimates: Sequence[ObjectEstimate]) -> ObjectEstimate:
    """Merge estimates of one object from several cameras; each axis by 1 / variance.

    Where they differ by more than their spreads say, the spread of the mean grows by as much (Birge's ratio).

    Those that do not agree with the one of smallest spread are another thing of the same appearance, or a mistake; they
    are left out. Evidence is kept of those merged.

    Args:
        estimates: At least one, all of one name.
    """
    ranked = sorted(estimates, key=lambda e: float(np.linalg.norm(e.position_std)))
    best = ranked[0]
    same = [best, *(turned_like(e, best.yaw) for e in ranked[1:] if e.shape == best.shape and agree(best, e))]
    if len(same) == 1:
        return best
    variance = np.array([e.position_std**2 for e in same])
    weight = 1.0 / variance
    position, position_std = _mean(np.array([e.position for e in same]), np.array([e.position_std for e in same]))
    sides = np.array([e.extents for e in same])
    sizes = [e.extents_std for e in same if e.extents_std is not None]
    extents_std = None
    if len(sizes) == len(same):
        extents, extents_std = _mean(sides, np.array(sizes))
    else:
        extents = (sides * (weight.sum(1) / weight.sum())[:, None]).sum(0)
    pose = np.eye(4)
    yaw_std = best.yaw_std
    if np.isfinite(best.yaw_std):
        yaws = np.array([best.yaw + np.angle(np.exp(1j * (e.yaw - best.yaw))) for e in same])
        yaw, yaw_std = (float(v) for v in _mean(yaws, np.array([e.yaw_std for e in same])))
        pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = position
    return replace(
        best,
        world_T_object=pose,
        extents=extents,
        position_std=position_std,
        yaw_std=yaw_std,
        score=max(e.score for e in same),
        stamp=max(e.stamp for e in same),
        extents_std=extents_std,
        evidence=tuple(item for e in same for item in e.evidence),
    )


def _mean(values: np.ndarray, stds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean by 1 / variance over the first axis, and its spread; shape (n, ...) to (...), both.

    Args:
        values: At least two.
        stds: Their spreads, same shape.
    """
    weight = 1.0 / stds**2
    mean = (values * weight).sum(0) / weight.sum(0)
    ratio = (weight * (values - mean) ** 2).sum(0) / (len(values) - 1)
    return mean, np.sqrt(np.maximum(ratio / BY_CHANCE, 1.0) / weight.sum(0))
