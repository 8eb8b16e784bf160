"""Solids of the masks of one picture, from the lowest upwards: what carries a thing is known before the thing."""

from collections.abc import Mapping, Sequence

import numpy as np

from perception.catalogue.catalogue import Catalogue
from perception.catalogue.phrases import appearance_of
from perception.estimates import Evidence, ObjectEstimate
from perception.geometry.pose import MaskedCloud, PoseSettings, fit_solid, masked_cloud
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.shape_choice import kinds_of
from perception.geometry.solids import Solid
from perception.interfaces import Detection

ENOUGH_DEPTH = 0.7  # where less of a thing's depth was measured its score falls with the share


def solids_of(
    frame: PreparedFrame,
    boxes: Mapping[str, Detection],
    masks: Mapping[str, np.ndarray],
    boards: Sequence[Solid],
    settings: PoseSettings,
    source: str,
    catalogue: Catalogue | None = None,
) -> tuple[dict[str, ObjectEstimate], dict[str, str]]:
    """Estimates by name, and why there is none, by name.

    Args:
        frame: The picture.
        boxes: By name.
        masks: Of the same names, bool, shape (height, width).
        boards: Solids in the world on which things may stand, known beforehand.
        settings: Of the pose estimate.
        source: Which detector and segmenter, for people to read.
        catalogue: What nouns look like; the built-in one if None.
    """
    missing: dict[str, str] = {}
    clouds: dict[str, MaskedCloud] = {}
    for name, mask in masks.items():
        cloud = masked_cloud(frame, mask, frame.support, settings, boxes[name].behind)
        if isinstance(cloud, str):
            missing[name] = cloud
        else:
            clouds[name] = cloud
    found: dict[str, ObjectEstimate] = {}
    solids, vessels = list(boards), []
    upwards = sorted(clouds, key=lambda n: clouds[n].lowest)
    for i, name in enumerate(upwards):
        cloud, box = clouds[name], boxes[name]
        above = np.zeros_like(cloud.mask)
        for other in upwards[i + 1 :]:
            above |= clouds[other].mask
        appearance = appearance_of(box.phrase, catalogue)
        fitted = fit_solid(
            frame, cloud, kinds_of(appearance), frame.support, solids, above, vessels, appearance.equal_sides
        )
        (vessels if appearance.hollow else solids).append(fitted.solid)
        scale_std = frame.scale_std(*fitted.solid.centre[:2])
        off = scale_std * np.abs(fitted.solid.centre - frame.world_T_camera[:3, 3])
        evidence = Evidence(frame.camera, box.box_px, cloud.mask, cloud.depth_share, source)
        found[name] = ObjectEstimate(
            name=name,
            phrase=box.phrase,
            world_T_object=fitted.solid.pose,
            extents=fitted.solid.extents,
            shape=fitted.solid.shape,
            position_std=np.hypot(fitted.position_std, off),
            yaw_std=fitted.yaw_std,
            score=float(np.clip(box.score, 0.0, 1.0) * min(1.0, cloud.depth_share / ENOUGH_DEPTH)),
            stamp=frame.stamp,
            evidence=(evidence,),
            extents_std=np.hypot(fitted.extents_std, scale_std * fitted.solid.extents),
        )
    return found, missing
