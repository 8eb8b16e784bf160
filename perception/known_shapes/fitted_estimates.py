"""Fits as estimates, with the pixels that agree with them as evidence."""

from collections.abc import Sequence

import cv2
import numpy as np

from perception.estimates import Evidence, ObjectEstimate
from perception.frames import RgbdFrame
from perception.geometry.depth_rays import DepthRays
from perception.known_shapes.articulated_fit import KnownFit
from perception.known_shapes.form_fit import FormFit

LEAST_PX = 5  # a camera in which fewer rays agree with a form shows nothing of it


def known_estimate(fit: KnownFit, frames: Sequence[RgbdFrame]) -> ObjectEstimate:
    """A known model that was found.

    Args:
        fit: The fit.
        frames: The pictures that it was fitted to.
    """
    seen = zip(frames, fit.pixels, strict=False)  # cameras after the last one with any ray have no pixels
    names = [part.name for part in fit.model.parts]
    return ObjectEstimate(
        name=fit.model.name,
        phrase=fit.model.name.replace("_", " "),
        world_T_object=fit.world_T_model,
        extents=fit.model.extents,
        shape="box",
        position_std=fit.position_std,
        yaw_std=fit.yaw_std,
        score=float(np.clip(fit.agreeing, 0.0, 1.0)),
        stamp=max(frame.stamp for frame in frames),
        evidence=tuple(_evidence(frame, px, fit.stride, "known shape") for frame, px in seen if len(px)),
        joint_fractions=dict(zip(names, map(float, fit.fractions), strict=True)),
        joint_stds=dict(zip(names, map(float, fit.fraction_std), strict=True)),
        extents_std=np.zeros(3),
    )


def form_estimate(
    fit: FormFit, name: str, rays: DepthRays, frames: Sequence[RgbdFrame], stride: int, model_std: float
) -> ObjectEstimate:
    """A thing of known form that was found.

    Args:
        fit: The fit.
        name: Scene name.
        rays: That it was fitted to.
        frames: Their pictures.
        stride: Every how many rows and columns there is a ray.
        model_std: Least spread in [m].
    """
    evidence = []
    for i, frame in enumerate(frames):
        own = rays.pixel[fit.rays[rays.frame[fit.rays] == i]]
        if len(own) >= LEAST_PX:
            evidence.append(_evidence(frame, own, stride, "known form"))
    sizes = np.hypot(np.sqrt(np.diag(fit.covariance)[3:]) * fit.extents, model_std)
    level = np.hypot(np.sqrt(np.diag(fit.covariance)[:2]), model_std)
    tall = float(np.hypot(0.0015, sizes[2] / 2))
    return ObjectEstimate(
        name=name,
        phrase=name.replace("_", " "),
        world_T_object=fit.pose,
        extents=fit.extents,
        shape="box",
        position_std=np.array([*level, tall]),
        yaw_std=float(np.hypot(np.sqrt(fit.covariance[2, 2]), 0.003)),
        score=float(np.clip(fit.agreeing, 0.0, 1.0)),
        stamp=max(frame.stamp for frame in frames),
        evidence=tuple(evidence),
        extents_std=sizes,
    )


def _evidence(frame: RgbdFrame, pixels: np.ndarray, stride: int, source: str) -> Evidence:
    """Pixels (row, column) that agree, shape (m, 2), with those around them that were not looked at."""
    mask = np.zeros(frame.depth.shape, np.uint8)
    mask[tuple(pixels.T)] = 1
    mask = cv2.dilate(mask, np.ones((stride + 1, stride + 1), np.uint8)) > 0
    v, u = np.nonzero(mask)
    box = np.array([u.min(), v.min(), u.max() + 1, v.max() + 1], float)
    return Evidence(frame.camera, box, mask, float(frame.valid_depth[mask].mean()), source)
