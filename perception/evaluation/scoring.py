"""Scores of many frames against what truly was in them: what a recording or a benchmark adds up to."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from perception.detection.nms import box_iou
from perception.estimates import ObjectEstimate, SceneEstimate
from perception.evaluation.coverage import Claimed, claimed, coverage
from perception.evaluation.metrics import (
    RIGHT_IOU,
    PoseError,
    ScoredQuestion,
    absent_false_positive_rate,
    average_precision,
    compare,
    mask_iou,
    median_p95,
    recall,
)
from perception.ground_truth import FrameTruth, TrueObject
from perception.interfaces import Detection

NO_JOINTS: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class _Seen:
    """One estimate of a thing that truly is there.

    Attributes:
        group: Label of the frame.
        error: Of its pose.
        mask_iou: NaN where a mask is unknown.
        right_thing: Whether its box overlaps the true one.
        joints: Error of each joint, share of the full way.
        doors_deg: The same of each hinge in [degrees].
    """

    group: str
    error: PoseError
    mask_iou: float
    right_thing: bool
    joints: tuple[float, ...]
    doors_deg: tuple[float, ...]


@dataclass
class Scores:
    """Adds up frames; keeps numbers only, no pictures.

    Attributes:
        threshold: Score from which a box counts as an answer, 0..1.
    """

    threshold: float = 0.0
    _questions: list[ScoredQuestion] = field(default_factory=list, repr=False)
    _seen: list[_Seen] = field(default_factory=list, repr=False)
    _claimed: list[Claimed] = field(default_factory=list, repr=False)
    _frames: int = 0
    _objects: int = 0

    @property
    def frames(self) -> int:
        """Frames so far."""
        return self._frames

    def add(
        self,
        scene: SceneEstimate,
        truth: FrameTruth,
        boxes: Sequence[Detection] | None,
        names: Sequence[str],
        camera: str,
        group: str = "",
        hinges_deg: Mapping[str, float] = NO_JOINTS,
        boxes_only: Collection[str] = (),
    ) -> None:
        """Score one frame.

        Args:
            scene: What was perceived in it.
            truth: What truly was.
            boxes: All boxes that the detector drew for it, also those below the threshold; None if none was asked.
            names: What was looked for; a name counts only where the truth knows that it is there or is not.
            camera: Which camera's boxes and masks the truth is about.
            group: Label under which its errors are listed as well, for instance the camera's distance.
            hinges_deg: By joint name, how far a hinge turns from closed to open in [degrees].
            boxes_only: Names whose poses are not judged, only the boxes drawn for them.
        """
        self._frames += 1
        for name in dict.fromkeys(names):
            there = [t for t in truth.objects if t.name == name]
            if not there and name not in truth.absent:
                continue
            if name not in boxes_only:
                self._objects += len(there)
            if boxes is not None:
                self._ask(name, there, boxes)
            if name in boxes_only:
                continue
            estimates = [o for o in scene.objects if o.phrase.replace(" ", "_") == name]
            pairs = _pairs(estimates, there)
            for estimate, thing in pairs:
                self._seen.append(_score(estimate, thing, camera, group, hinges_deg))
                if self._seen[-1].right_thing:
                    self._claimed.append(claimed(estimate, thing))
            reason = next((u.reason for u in scene.unseen if u.name == name), "not seen")
            posed = [id(thing) for _, thing in pairs]
            self._claimed += [claimed(None, thing, reason) for thing in there if id(thing) not in posed]

    def _ask(self, name: str, there: list[TrueObject], boxes: Sequence[Detection]) -> None:
        if any(t.box_px is None for t in there):
            return
        own = [b for b in boxes if b.phrase.replace(" ", "_") == name]
        self._questions.append(
            ScoredQuestion(
                np.array([b.box_px for b in own], float).reshape(-1, 4),
                np.array([b.score for b in own], float),
                np.array([t.box_px for t in there], float).reshape(-1, 4),
            )
        )

    def extend(self, other: "Scores") -> None:
        """Take in the frames of another, for instance of another process."""
        self._questions += other._questions
        self._seen += other._seen
        self._claimed += other._claimed
        self._frames += other._frames
        self._objects += other._objects

    def errors(self, name: str | None = None) -> list[PoseError]:
        """Pose errors of the right things, of one name or of all."""
        return [s.error for s in self._seen if s.right_thing and (name is None or s.error.name == name)]

    def as_json(self) -> dict[str, Any]:
        """All figures; null where there was nothing to measure.

        Errors of masks, poses and joints are those of estimates whose box lies on the thing meant (IoU >= 0.5);
        `wrong_thing_rate` says how many lie on another thing.
        """
        right = [s for s in self._seen if s.right_thing]
        groups = sorted({s.group for s in self._seen} - {""})
        measures = {
            "position_mm": lambda s: (s.error.position_mm,),
            "yaw_deg": lambda s: (s.error.yaw_deg,),
            "extent_mm": lambda s: (s.error.extents_mm,),
            "error_by_spread": lambda s: (s.error.normalised,),
            "joint_fraction": lambda s: s.joints,
            "door_angle_deg": lambda s: s.doors_deg,
        }
        figures: dict[str, Any] = {
            "n_frames": self._frames,
            "n_objects": self._objects,
            "ap50": _number(average_precision(self._questions)),
            "recall": _number(recall(self._questions, self.threshold)),
            "absent_false_positive_rate": _number(absent_false_positive_rate(self._questions, self.threshold)),
            "posed": _number(len(right) / self._objects if self._objects else float("nan")),
            "wrong_thing_rate": _number(1.0 - len(right) / len(self._seen) if self._seen else float("nan")),
            "mask_iou": _mean([s.mask_iou for s in right]),
        }
        for label, of in measures.items():
            row: dict[str, Any] = median_p95(v for s in right for v in of(s))
            if groups:
                row["by_group"] = {g: median_p95(v for s in right if s.group == g for v in of(s)) for g in groups}
            figures[label] = row
        figures["spreads"] = coverage(self._claimed)
        return figures


def scores_text(figures: Mapping[str, Any]) -> str:
    """The figures of `Scores.as_json` for people, a line each."""

    def number(value: float | None, unit: str = "") -> str:
        return "not measured" if value is None else f"{value:.3g}{unit}"

    lines = [f"against the truth of {figures['n_frames']} frames with {figures['n_objects']} objects asked for:"]
    for key, label in SCORE_NAMES.items():
        value = figures[key]
        if isinstance(value, Mapping):
            if value["median"] is not None:
                lines.append(f"  {label:46} median {number(value['median'])}, 95 % {number(value['p95'])}")
        else:
            lines.append(f"  {label:46} {number(value)}")
    return "\n".join(lines)


SCORE_NAMES = {
    "ap50": "AP50 of boxes",
    "recall": "share of things found by a box",
    "absent_false_positive_rate": "share of absent things answered with a box",
    "posed": "share of things posed",
    "wrong_thing_rate": "share of poses that are of another thing",
    "mask_iou": "mean mask IoU",
    "position_mm": "position error [mm]",
    "yaw_deg": "yaw error [degrees]",
    "extent_mm": "error of the worst side [mm]",
    "error_by_spread": "position error by claimed spread",
    "joint_fraction": "joint error, share of its way",
    "door_angle_deg": "door angle error [degrees]",
}


def _score(
    estimate: ObjectEstimate, thing: TrueObject, camera: str, group: str, hinges_deg: Mapping[str, float]
) -> _Seen:
    seen = next((e for e in estimate.evidence if e.camera == camera), None)
    right, overlap = True, float("nan")
    if seen is not None and thing.box_px is not None:
        right = bool(box_iou(seen.box_px, thing.box_px)[0, 0] >= RIGHT_IOU)
    if seen is not None and thing.mask is not None:
        overlap = mask_iou(seen.mask, thing.mask)
    joints = {
        name: abs(estimate.joint_fractions[name] - fraction)
        for name, fraction in thing.joint_fractions.items()
        if name in estimate.joint_fractions
    }
    doors = tuple(off * hinges_deg[name] for name, off in joints.items() if name in hinges_deg)
    return _Seen(group, compare(estimate, thing), overlap, right, tuple(joints.values()), doors)


def _pairs(
    estimates: Sequence[ObjectEstimate], things: Sequence[TrueObject]
) -> list[tuple[ObjectEstimate, TrueObject]]:
    """Each estimate with the nearest thing that no nearer estimate has taken."""
    distances = [
        (float(np.linalg.norm(e.position - t.world_T_object[:3, 3])), i, j)
        for i, e in enumerate(estimates)
        for j, t in enumerate(things)
    ]
    pairs, taken_estimates, taken_things = [], set(), set()
    for _, i, j in sorted(distances):
        if i not in taken_estimates and j not in taken_things:
            pairs.append((estimates[i], things[j]))
            taken_estimates.add(i)
            taken_things.add(j)
    return pairs


def _number(value: float) -> float | None:
    return round(value, 4) if np.isfinite(value) else None


def _mean(values: Sequence[float]) -> float | None:
    known = [v for v in values if np.isfinite(v)]
    return _number(float(np.mean(known))) if known else None
