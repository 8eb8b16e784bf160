"""Rotations as vectors, for many at once: logarithm, exponential, straight-line poses between two poses."""

import numpy as np


def rotation_log(rotations: np.ndarray) -> np.ndarray:
    """Rotation vectors: axis times angle, angle from 0 to pi, in [rad]; shape (..., 3, 3) → (..., 3).

    With v = vee(R - R^T) / 2 = sin(a) axis and c = (tr R - 1) / 2 = cos(a), the log is v a / sin(a), a = atan2(|v|, c).
    Near a = pi, where v vanishes, the axis is the column of (R + R^T) / 2 - c I = (1 - c) axis axis^T with the largest
    diagonal, with the sign of v.
    """
    r = np.asarray(rotations, float)
    v = 0.5 * np.stack([r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], axis=-1)
    sine = np.linalg.norm(v, axis=-1)
    cosine = 0.5 * (np.trace(r, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    result = v * (angle / np.where(sine > 1e-9, sine, 1.0))[..., None]
    small = (sine <= 1e-9) & (cosine > 0)
    result = np.where(small[..., None], v, result)
    flipped = (cosine < 0) & (sine < 1e-3)
    if np.any(flipped):
        part, c = r[flipped], cosine[flipped]
        outer = 0.5 * (part + part.transpose(0, 2, 1)) - c[:, None, None] * np.eye(3)
        column = np.argmax(outer[:, range(3), range(3)], axis=1)
        axis = outer[np.arange(len(part)), :, column]
        axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
        sign = np.where(np.einsum("ni,ni->n", axis, v[flipped]) < 0.0, -1.0, 1.0)
        result[flipped] = axis * (sign * angle[flipped])[:, None]
    return result


def rotation_exp(vectors: np.ndarray) -> np.ndarray:
    """Rotations of rotation vectors in [rad], Rodrigues' formula; shape (..., 3) → (..., 3, 3).

    R = I + sin(a)/a K + (1 - cos(a))/a^2 K^2 with K the cross-product matrix of the vector and a its length.
    """
    v = np.asarray(vectors, float)
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    k = np.zeros((*v.shape[:-1], 3, 3))
    k[..., 0, 1], k[..., 0, 2], k[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    k -= np.swapaxes(k, -1, -2)
    # np.sinc(x) = sin(pi x) / (pi x), defined at zero; (1 - cos a) / a^2 = sinc(a/2)^2 / 2.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.eye(3) + first * k + second * (k @ k)


def straight_poses(start: np.ndarray, end: np.ndarray, count: int) -> np.ndarray:
    """Evenly spaced poses on straight lines, turning about one fixed axis; the start is left out.

    Args:
        start, end: Transforms, shape (n, 4, 4), translations in [m].
        count: Number of waypoints; the last is the end.

    Returns:
        Transforms, shape (n, count, 4, 4).
    """
    share = np.arange(1, count + 1) / count
    turn = rotation_log(end[:, :3, :3] @ np.swapaxes(start[:, :3, :3], -1, -2))
    poses = np.tile(np.eye(4), (len(start), count, 1, 1))
    poses[:, :, :3, :3] = rotation_exp(share[:, None] * turn[:, None]) @ start[:, None, :3, :3]
    poses[:, :, :3, 3] = start[:, None, :3, 3] + share[:, None] * (end - start)[:, None, :3, 3]
    return poses


def rolled(world_T_object: np.ndarray, axis: int, angle: float) -> np.ndarray:
    """The pose (4, 4) turned in place by `angle` [rad] about one of the object's own axes, 0 to 2 for x to z."""
    direction = np.zeros(3)
    direction[axis] = angle
    out = world_T_object.copy()
    out[:3, :3] = world_T_object[:3, :3] @ rotation_exp(direction)
    return out
