"""How good a look was, measured against what truly was there: boxes, masks, poses, joints. Needs numpy only.

Boxes are judged over questions. A question is one phrase asked of one picture; its detections are compared with the
true boxes of that phrase in that picture. A detection is right when it overlaps a true box that no better-scored one
has taken with IoU >= 0.5.

    AP50 = sum over i of (r_i - r_(i-1)) * max over j >= i of p_j

with precision p_i and recall r_i over the first i of all detections of all questions, best score first (COCO's
matching, interpolated at every point instead of 101).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from perception.detection.nms import box_iou
from perception.estimates import ObjectEstimate
from perception.ground_truth import TrueObject

RIGHT_IOU = 0.5
SQUARE = 0.1  # sides that differ by less than this share make a footprint square


@dataclass(frozen=True)
class ScoredQuestion:
    """One phrase asked of one picture.

    Attributes:
        boxes: What the detector drew, (x0, y0, x1, y1) in [px], shape (n, 4).
        scores: Their scores, 0..1, shape (n,).
        truth: Boxes of what truly is there, in [px], shape (m, 4); m is 0 where the phrase was asked for in vain.
    """

    boxes: NDArray[np.float64]
    scores: NDArray[np.float64]
    truth: NDArray[np.float64]

    def right(self, iou: float = RIGHT_IOU) -> np.ndarray:
        """Which boxes are right, bool, shape (n,)."""
        right = np.zeros(len(self.scores), bool)
        overlap = box_iou(self.boxes, self.truth)
        for i in np.argsort(-self.scores, kind="stable"):
            if overlap.shape[1] == 0:
                break
            best = int(np.argmax(overlap[i]))
            if overlap[i, best] >= iou:
                right[i] = True
                overlap[:, best] = -1.0
        return right


def average_precision(questions: Sequence[ScoredQuestion], iou: float = RIGHT_IOU) -> float:
    """Area under precision over recall, 0..1; NaN when nothing was there in any question.

    Args:
        questions: All that was asked, in vain or not.
        iou: Least overlap of a right box, 0..1.
    """
    wanted = sum(len(q.truth) for q in questions)
    if wanted == 0:
        return float("nan")
    scores = np.concatenate([q.scores for q in questions])
    if not len(scores):
        return 0.0
    right = np.concatenate([q.right(iou) for q in questions])[np.argsort(-scores, kind="stable")]
    found = np.cumsum(right)
    precision = found / np.arange(1, len(right) + 1)
    best_from_here = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(best_from_here[right]) / wanted)


def recall(questions: Sequence[ScoredQuestion], threshold: float = 0.0, iou: float = RIGHT_IOU) -> float:
    """Share of the true boxes that a box of at least `threshold` found, 0..1; NaN when nothing was there.

    Args:
        questions: All that was asked.
        threshold: Lowest score that counts, 0..1.
        iou: Least overlap of a right box, 0..1.
    """
    wanted = sum(len(q.truth) for q in questions)
    if wanted == 0:
        return float("nan")
    return sum(int((q.right(iou) & (q.scores >= threshold)).sum()) for q in questions) / wanted


def absent_false_positive_rate(questions: Iterable[ScoredQuestion], threshold: float = 0.0) -> float:
    """Share of the questions about absent things that were answered with a box, 0..1; NaN when there was none.

    Args:
        questions: All that was asked; only those without a true box count.
        threshold: Lowest score that counts as an answer, 0..1.
    """
    answered = [bool((q.scores >= threshold).any()) for q in questions if len(q.truth) == 0]
    return float(np.mean(answered)) if answered else float("nan")


def mask_iou(mask: np.ndarray, truth: np.ndarray) -> float:
    """Intersection over union of two masks, bool of one shape, 0..1; two empty masks agree."""
    union = int((mask | truth).sum())
    return float((mask & truth).sum() / union) if union else 1.0


@dataclass(frozen=True)
class PoseError:
    """One estimate against the truth.

    Attributes:
        name: Object.
        position_mm: Distance of the centres.
        yaw_deg: Turn between the boxes, up to the turns that map the box onto itself (axes may be named otherwise:
            at most 45); NaN for round things.
        extents_mm: Largest difference of a side; NaN where the true sizes are unknown.
        normalised: Distance of the centres by the spread that the estimate claims, root mean square of the axes.
    """

    name: str
    position_mm: float
    yaw_deg: float
    extents_mm: float
    normalised: float


def compare(estimate: ObjectEstimate, truth: TrueObject) -> PoseError:
    """Score one estimate against what it is an estimate of."""
    off, yaw_deg, sides, _ = errors_of(estimate, truth)
    return PoseError(
        estimate.name,
        1e3 * float(np.linalg.norm(off)),
        abs(yaw_deg),
        float("nan") if sides is None else 1e3 * float(np.abs(sides).max()),
        float(np.sqrt(np.mean((off / estimate.position_std) ** 2))),
    )


def errors_of(
    estimate: ObjectEstimate, truth: TrueObject
) -> tuple[np.ndarray, float, np.ndarray | None, np.ndarray | None]:
    """Errors of an estimate, its axes named as it names them.

    Returns:
        Of the centre in the world in [m], shape (3,); of the yaw in [degrees], NaN for round things; of the sizes in
        [m], shape (3,), None where the true ones are unknown; the spreads claimed for these, in the same order, None
        where nobody says. Sides of a square footprint are compared by size, as their names mean nothing.
    """
    off = estimate.position - truth.world_T_object[:3, 3]
    turn, axes = _named_alike(estimate.world_T_object[:3, :3], truth.world_T_object[:3, :3])
    angular = estimate.shape == "box" and truth.shape not in ("sphere", "cylinder")
    yaw = turn if angular else float("nan")
    stds = None if estimate.extents_std is None else np.array(estimate.extents_std, float)
    if truth.extents is None:
        return off, yaw, None, stds
    sides, true_sides = np.array(estimate.extents, float), np.asarray(truth.extents, float)[axes]
    if abs(true_sides[0] - true_sides[1]) < SQUARE * true_sides[:2].max():
        order = np.argsort(sides[:2])
        sides[:2], true_sides[:2] = sides[:2][order], np.sort(true_sides[:2])
        if stds is not None:
            stds[:2] = stds[:2][order]
    return off, yaw, sides - true_sides, stds


def _named_alike(rotation: np.ndarray, truth: np.ndarray) -> tuple[float, np.ndarray]:
    """Turn about z in [degrees] that is left when the true axes are renamed, and which true axis is which, (3,)."""
    best = max(_BOX_TURNS, key=lambda turn: float(np.trace(rotation.T @ truth @ turn)))
    left = truth @ best @ rotation.T
    angle = np.degrees(np.arctan2(left[1, 0] - left[0, 1], left[0, 0] + left[1, 1]))
    return float(angle), np.argmax(np.abs(best), axis=0)


def _turns_of_a_box() -> tuple[np.ndarray, ...]:
    """The 24 rotations that map axes onto axes, each of shape (3, 3)."""
    turns = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = np.zeros((3, 3))
        turn[order, range(3)] = signs
        if np.linalg.det(turn) > 0:
            turns.append(turn)
    return tuple(turns)


_BOX_TURNS = _turns_of_a_box()


def median_p95(values: Iterable[float]) -> dict[str, float | None]:
    """Median and 95 % quantile of the finite ones among values; None where there is none."""
    known = np.array([v for v in values if np.isfinite(v)])
    if not len(known):
        return {"median": None, "p95": None}
    return {"median": round(float(np.median(known)), 3), "p95": round(float(np.quantile(known, 0.95)), 3)}


def summary(errors: Sequence[PoseError]) -> dict[str, float]:
    """Number of estimates, and median and 95 % quantile of every measure; NaN where nothing was measured."""
    row: dict[str, float] = {"n": len(errors)}
    for key in ("position_mm", "yaw_deg", "extents_mm", "normalised"):
        for label, value in median_p95(getattr(e, key) for e in errors).items():
            row[f"{key}_{label}"] = float("nan") if value is None else value
    return row
