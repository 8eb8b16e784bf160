"""Perception as it looks at the frames of one recording: with a detector, or with boxes or masks drawn by hand."""

from collections.abc import Sequence
from dataclasses import replace
from math import degrees

import numpy as np

from perception.detection.given import BoxesByFrame, MasksByFrame
from perception.estimates import SceneEstimate, Unseen
from perception.evaluation.recording_detector import RecordingDetector
from perception.geometry.prepared_frame import prepared
from perception.pipeline import Perception, perception_from_options
from perception.unexplained.unnamed_things import Known, UnnamedThings
from replan.perceive.frame_stream import KeyedFrame
from replan.perceive.options import PerceiveOptions
from sim_check.cells.loading import load_cell
from sim_check.furniture.known_models import known_models
from sim_check.models.known_forms import known_forms


class FramePerception:
    """Looks at one frame at a time.

    Args:
        options: What to look for, and how.
        keys: Keys of all frames, or None where only reading would tell.

    Attributes:
        names: What is looked for.
        given: Boxes or masks that were drawn by hand, or None.
        hinges_deg: How far each hinge of known furniture opens, by its name.
        source: Which detector and segmenter, plainly named.

    Raises:
        ConfigError: There is no such cell, or boxes or masks cannot be read.
        FrameError: Boxes or masks are not valid.
    """

    def __init__(self, options: PerceiveOptions, keys: Sequence[str] | None) -> None:
        self.given: BoxesByFrame | MasksByFrame | None = None
        if options.boxes is not None:
            self.given = BoxesByFrame(options.boxes, keys)
        elif options.masks is not None:
            self.given = MasksByFrame(options.masks, keys)
        self.names = options.names or (self.given.names if self.given else ())
        cell = load_cell() if options.cell is None else load_cell(options.cell)
        known = {} if options.cell is None else known_models(cell.furniture)
        self._unnamed = UnnamedThings() if options.unnamed else None
        self._known = Known(np.array(cell.workspace.low), np.array(cell.workspace.high), None, known)
        embedded = perception_from_options(
            options.detector, options.segmenter, options.perception, known, known_forms()
        )
        self._perception = replace(embedded, instances=options.instances)
        self.hinges_deg = {p.name: degrees(p.opened) for m in known.values() for p in m.parts if p.kind == "hinge"}
        self.source = self._for_frame(None)[0].name

    def look(self, item: KeyedFrame) -> tuple[SceneEstimate, RecordingDetector]:
        """What is seen in a frame, and its detector, which tells all boxes that it drew.

        Raises:
            FrameError: The frame cannot be used.
            ModelUnavailableError, UnknownPhraseError: As `perception.pipeline.Perception.perceive` raises them.
        """
        perception, detector = self._for_frame(item.key)
        frames = prepared([item.frame])
        scene = self._with_given_reasons(perception.perceive(frames, self.names))
        return (scene if self._unnamed is None else self._unnamed.added(scene, frames, self._known)), detector

    def _for_frame(self, key: str | None) -> tuple[Perception, RecordingDetector]:
        """Perception for the frame of this key, and its detector."""
        detector, segmenter = self._perception.detector, self._perception.segmenter
        if isinstance(self.given, BoxesByFrame):
            detector = self.given.of(key or "")
        elif isinstance(self.given, MasksByFrame):
            detector = segmenter = self.given.of(key or "")
        recorder = RecordingDetector(detector, options=self._perception.options)
        return replace(self._perception, detector=recorder, segmenter=segmenter), recorder

    def _with_given_reasons(self, scene: SceneEstimate) -> SceneEstimate:
        """Where boxes or masks are given, a name without one was not missed by a detector."""
        if self.given is None:
            return scene
        what = "box" if isinstance(self.given, BoxesByFrame) else "mask"
        unseen = (
            Unseen(u.name, f"no {what} was given for this frame") if u.reason == "no box above the threshold" else u
            for u in scene.unseen
        )
        return replace(scene, unseen=tuple(unseen))
