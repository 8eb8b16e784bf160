"""A noun that says round or angular, held against what the other cameras show of the same thing.

A ball of which a door frame hides a slice has straight edges: a camera that sees it so takes a green apple for a green
cube. Another camera that sees more of it does not. An outline is known to a pixel or so, whence a detection tells as
much as its score times its longer side in pixels; a noun is given up where the other shape's detections tell more.
"""

from collections.abc import Sequence

import numpy as np

from perception.estimates import ObjectEstimate
from perception.geometry.prepared_frame import PreparedFrame
from perception.interfaces import Detection, ShapeDetector

APART = 0.03  # how far apart two views of one thing may seem beyond their spreads and half its size, in [m]


def shape_conflict(
    phrase: str, seen: Sequence[ObjectEstimate], frames: Sequence[PreparedFrame], detector: ShapeDetector
) -> str | None:
    """Why what some cameras saw is not of the shape that its noun says, or None if the others do not object.

    Args:
        phrase: What was asked for.
        seen: Estimates of it, one a camera at most.
        frames: Of all cameras.
        detector: Is asked for the other shape in the pictures of those cameras that did not see the phrase.
    """
    other = detector.other_shape(phrase)
    if other is None or not seen:
        return None
    speaking = [item.camera for estimate in seen for item in estimate.evidence]
    for_it = sum(estimate.score * _longer_side(item.box_px) for estimate in seen for item in estimate.evidence)
    against, cameras = 0.0, []
    for frame in frames:
        if frame.camera in speaking:
            continue
        told = [
            d.score * _longer_side(d.box_px)
            for d in detector.detect(frame, [other])
            if any(_same_place(frame, d, estimate) for estimate in seen)
        ]
        if told:
            against += max(told)
            cameras.append(frame.camera)
    if against <= for_it:
        return None
    return (
        f"what {' and '.join(map(repr, speaking))} took for it is rather a {other} in the larger picture of "
        f"{' and '.join(map(repr, cameras))}"
    )


def _longer_side(box_px: np.ndarray) -> float:
    return float((box_px[2:] - box_px[:2]).max())


def _same_place(frame: PreparedFrame, detection: Detection, estimate: ObjectEstimate) -> bool:
    known = frame.valid_depth & (detection.seed if detection.seed is not None else False)
    if not known.any():
        return False
    middle = np.median(frame.points(known), axis=0)
    reach = APART + float(estimate.extents.max()) / 2 + 3.0 * float(np.linalg.norm(estimate.position_std))
    return bool(np.linalg.norm(middle - estimate.position) < reach)
