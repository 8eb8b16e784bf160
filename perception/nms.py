"""Non-maximum suppression: of boxes that overlap, the one with the best score stays."""

from collections.abc import Sequence

import numpy as np

from perception.interfaces import Detection


def box_iou(boxes_a: np.ndarray, boxes_b: np.ndarray) -> np.ndarray:
    """Intersection over union of boxes (x0, y0, x1, y1): shapes (n, 4) and (m, 4) give (n, m), each 0..1.

    An empty box has IoU 0 with everything.
    """
    a = np.asarray(boxes_a, float).reshape(-1, 1, 4)
    b = np.asarray(boxes_b, float).reshape(1, -1, 4)
    sides = np.clip(np.minimum(a[..., 2:], b[..., 2:]) - np.maximum(a[..., :2], b[..., :2]), 0.0, None)
    shared = sides.prod(-1)
    area_a = np.clip(a[..., 2:] - a[..., :2], 0.0, None).prod(-1)
    area_b = np.clip(b[..., 2:] - b[..., :2], 0.0, None).prod(-1)
    union = area_a + area_b - shared
    return np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)


def suppress(
    detections: Sequence[Detection], same_phrase_iou: float = 0.5, other_phrase_iou: float = 0.75
) -> list[Detection]:
    """Drop boxes that overlap a better one, within a phrase and between phrases.

    Between phrases the limit is higher: an apple lies in a bowl and their boxes may well overlap, but two names for
    nearly one box ("red cube" and "apple" on the same pixels) are one thing under the better name.

    Args:
        detections: In any order.
        same_phrase_iou: Highest IoU with a better box of the same phrase, 0..1.
        other_phrase_iou: Highest IoU with a better box of another phrase, 0..1.

    Returns:
        Those that stay, best first; ties keep their order.
    """
    kept: list[Detection] = []
    for one in sorted(detections, key=lambda d: -d.score):
        overlaps = box_iou(one.box_px, np.array([k.box_px for k in kept]).reshape(-1, 4))[0]
        limits = [same_phrase_iou if k.phrase == one.phrase else other_phrase_iou for k in kept]
        if all(iou <= limit for iou, limit in zip(overlaps, limits, strict=True)):
            kept.append(one)
    return kept
