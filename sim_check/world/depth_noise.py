"""Stereo noise: what a stereo camera's depth looks like, given the true depth. Needs numpy and OpenCV.

A stereo camera measures the disparity d between two pictures and derives depth z from it:

    d = f b / z        sigma_z = z^2 / (f b) * sigma_d        (f in [px], b = baseline in [m])

Noise is therefore added to d, in this order:

1. matching:   d' = d + s g, with g = white noise smoothed over the matching window (Gaussian, `correlation_px`) and
               scaled to unit variance, s = `disparity_std_px`;
2. depth edges: where disparities within the window differ by more than `edge_disparity_px`, a share `flying_share`
               of the pixels takes the window's mean (points that fly between near and far) and a share
               `edge_dropout_share` is lost;
3. blobs:      where a second, coarser smoothed noise exceeds the quantile 1 - `blob_share`, nothing was matched;
4. sub-pixel steps: d'' = step * round(d' / step);
5. range:      depths outside `nearest` .. `farthest` are lost.

0.25 px, 63 mm and f = 700 px give 2.8 mm at 0.7 m, a ZED Mini's order. Lost pixels are NaN.
"""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from sim_check.cells.cell_config import DepthNoiseConfig

_EDGE_WINDOW = 5  # [px], side of the window that decides what is an edge
_BLOB_SIGMA = 9.0  # [px]


def stereo_depth(depth: np.ndarray, fx: float, noise: "DepthNoiseConfig", rng: np.random.Generator) -> np.ndarray:
    """Depth as a stereo camera would measure it.

    Args:
        depth: True distance along the optical axis in [m], shape (height, width); NaN where there is nothing.
        fx: Focal length in [px].
        noise: Size of each effect.
        rng: Source of randomness; the same generator state gives the same picture.

    Returns:
        Depth in [m], float32, shape (height, width), NaN where unknown.
    """
    import cv2

    scale = fx * noise.baseline
    nothing = ~np.isfinite(depth) | (depth <= 0)
    true = np.where(nothing, 0.0, scale / np.where(nothing, 1.0, depth)).astype(np.float32)
    matched = true + noise.disparity_std_px * _smooth_noise(rng, depth.shape, noise.correlation_px)

    window = np.ones((_EDGE_WINDOW, _EDGE_WINDOW), np.uint8)
    edge = cv2.dilate(true, window) - cv2.erode(true, window) > noise.edge_disparity_px
    fate = rng.random(depth.shape, dtype=np.float32)
    flying = edge & (fate < noise.flying_share)
    # Mixed with the same matching error, so that both sides and the points between them move together.
    matched = np.where(flying, cv2.blur(true, window.shape) + (matched - true), matched)
    lost = nothing | (edge & (fate >= 1.0 - noise.edge_dropout_share))

    if noise.blob_share > 0:
        coarse = _smooth_noise(rng, depth.shape, _BLOB_SIGMA)
        lost |= coarse > np.quantile(coarse, 1.0 - noise.blob_share)
    if noise.step_px > 0:
        matched = noise.step_px * np.round(matched / noise.step_px)
    lost |= (matched < scale / noise.farthest) | (matched > scale / noise.nearest)
    measured = scale / np.where(lost, 1.0, matched)
    return np.where(lost, np.nan, measured).astype(np.float32)


def _smooth_noise(rng: np.random.Generator, shape: tuple[int, ...], sigma: float) -> np.ndarray:
    """Gaussian noise correlated over `sigma` in [px], unit variance, float32."""
    import cv2

    smooth = cv2.GaussianBlur(rng.standard_normal(shape, dtype=np.float32), (0, 0), sigma)
    return smooth / smooth.std()
