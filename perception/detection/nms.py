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
    detections: Sequence[Detection],
    same_phrase_iou: float = 0.5,
    other_phrase_iou: float = 0.75,
    most_per_phrase: int | None = None,
) -> list[Detection]:
    """Drop boxes that overlap a better one, within a phrase and between phrases.

    Between phrases the limit is higher: an apple lies in a bowl and their boxes may well overlap, but two names for
    nearly one box ("red cube" and "apple" on the same pixels) are one thing under the better name.

    Args:
        detections: In any order.
        same_phrase_iou: Highest IoU with a better box of the same phrase, 0..1.
        other_phrase_iou: Highest IoU with a better box of another phrase, 0..1.
        most_per_phrase: At most so many boxes of a phrase stay; any number if None.

    Returns:
        Those that stay, best first; ties keep their order.
    """
    ranked = sorted(detections, key=lambda d: -d.score)
    numbers = {phrase: k for k, phrase in enumerate(dict.fromkeys(d.phrase for d in ranked))}
    boxes = np.array([d.box_px for d in ranked], float).reshape(-1, 4)
    phrases = np.array([numbers[d.phrase] for d in ranked], int)
    counts = dict.fromkeys(numbers.values(), 0)
    kept: list[int] = []
    for i, phrase in enumerate(phrases):
        if most_per_phrase is not None and counts[phrase] >= most_per_phrase:
            continue
        limits = np.where(phrases[kept] == phrase, same_phrase_iou, other_phrase_iou)
        if np.all(box_iou(boxes[i], boxes[kept])[0] <= limits):
            kept.append(i)
            counts[phrase] += 1
    return [ranked[i] for i in kept]
