"""Frames and names in, scene estimate out: detect, suppress, segment, lift to points, fit, merge cameras.

Each stage is a module of `perception.stages`; this one says in which order they come and how long they take.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from perception.catalogue.catalogue import Catalogue
from perception.errors import FrameError
from perception.estimates import ObjectEstimate, SceneEstimate, Unseen
from perception.frames import RgbdFrame
from perception.geometry.pose import PoseSettings
from perception.geometry.prepared_frame import PreparedFrame, prepared
from perception.geometry.solids import Solid
from perception.interfaces import Detection, Detector, Segmenter
from perception.known_shapes.forms import KnownForm
from perception.known_shapes.models import KnownModel
from perception.options import PerceptionOptions
from perception.stages.boxes_to_masks import masks_of
from perception.stages.camera_agreement import View, agreed
from perception.stages.doubts import with_doubts
from perception.stages.known_shapes_first import find_shapes, likeliest
from perception.stages.masks_to_solids import solids_of
from perception.stages.named_boxes import kept_boxes, named_boxes
from perception.stages.selection import detector_of, segmenter_of

STAGES = ("detect", "segment", "pose", "merge")


@dataclass(frozen=True)
class Perception:
    """A detector and a segmenter put to use.

    Attributes:
        detector: Draws boxes for phrases.
        segmenter: Turns boxes into masks.
        settings: Of the pose estimate.
        options: Which boxes that overlap are kept, and how many.
        instances: How many things one phrase may be; the best box is `name`, further ones name_2, name_3, ...
        known: Things whose shape is known beforehand, by name. They are looked for by their shape in the depth of all
            cameras together; the detector is not asked for them.
        forms: Things whose form is known up to its sizes, by noun. They too are looked for in the depth of all cameras
            together; the detector is asked where several things have the form, or none.
        catalogue: What nouns and colours look like; the built-in one if None.
    """

    detector: Detector
    segmenter: Segmenter
    settings: PoseSettings = field(default_factory=PoseSettings)
    options: PerceptionOptions = field(default_factory=PerceptionOptions)
    instances: int = 1
    known: Mapping[str, KnownModel] = field(default_factory=lambda: MappingProxyType({}))
    forms: Mapping[str, KnownForm] = field(default_factory=lambda: MappingProxyType({}))
    catalogue: Catalogue | None = None

    @property
    def name(self) -> str:
        """Detector and segmenter, for people to read."""
        return f"{self.detector.name} + {self.segmenter.name}"

    def perceive(
        self, frames: Sequence[RgbdFrame], names: Sequence[str], before: SceneEstimate | None = None
    ) -> SceneEstimate:
        """Look for named things in pictures of one moment, taken by one or several cameras.

        Args:
            frames: At least one; each with `world_T_camera` in one common world whose z is up. One that is a
                `PreparedFrame` is used as it is, with its noise and what was worked out of it before.
            names: Names such as "red_cube"; the phrase that is looked for is the name with spaces.
            before: What an earlier look saw. Things of known shape that still stand where they did are found there in
                less than half the time; the others are looked for everywhere, as without it.

        Returns:
            One estimate per name that was seen, or up to `instances` of it (things seen by several cameras are merged),
            the others with reasons.
            A camera without any depth (a wrist camera close to something) is left out and named in `source`.

        Raises:
            FrameError: No frame, or none with any depth.
            UnknownPhraseError: A name that the detector has no way to look for.
            ModelUnavailableError: The detector's or segmenter's weights are not on this machine.
        """
        seeing, blind = _with_depth(frames)
        wanted = tuple(dict.fromkeys(name.strip().lower().replace(" ", "_") for name in names))
        seconds: dict[str, float] = dict.fromkeys(STAGES, 0.0)
        with _timed(seconds, "pose"):
            shapes = find_shapes(seeing, wanted, self.known, self.forms, before, self.catalogue)
        with _timed(seconds, "detect"):
            formed = {
                name: likeliest(seen, self.instances, lambda phrase: self._boxes_by_camera(seeing, phrase))
                for name, seen in shapes.formed.items()
            }
        others = tuple(name for name in wanted if name not in shapes.models and name not in formed)
        views = [self._look(frame, others, shapes.boards, seconds) for frame in seeing]
        objects: list[ObjectEstimate] = []
        unseen: list[Unseen] = []
        with _timed(seconds, "merge"):
            for name in wanted:
                said = shapes.models.get(name, formed.get(name))
                if said is None:
                    taken = {*wanted, *(o.name for o in objects)}
                    form = shapes.forms.get(name)
                    said = agreed(name, views, seeing, self.detector, form, self.instances, taken, self.catalogue)
                if isinstance(said, str):
                    unseen.append(Unseen(name, said))
                else:
                    objects += [said] if isinstance(said, ObjectEstimate) else said
            objects = with_doubts(objects, seeing, self.known, self.catalogue)
        return SceneEstimate(
            objects=tuple(objects),
            unseen=tuple(unseen),
            support_height=float(np.median([f.support.height for f in seeing if f.support.seen] or [0.0])),
            stamp=max(frame.stamp for frame in seeing),
            source=self.name + "".join(f"; camera '{frame.camera}' has no depth" for frame in blind),
            seconds=seconds,
        )

    def _look(
        self, frame: PreparedFrame, names: tuple[str, ...], boards: Sequence[Solid], seconds: dict[str, float]
    ) -> View:
        """Everything one camera can say about what the detector finds; adds the time spent to `seconds`."""
        with _timed(seconds, "detect"):
            phrases = tuple(name.replace("_", " ") for name in names)
            boxes = named_boxes(kept_boxes(self.detector, frame, phrases, self.options), names, self.instances)
        with _timed(seconds, "segment"):
            masks = masks_of(self.segmenter, frame, boxes)
        with _timed(seconds, "pose"):
            found, missing = solids_of(frame, boxes, masks, boards, self.settings, self.name, self.catalogue)
        return View(found, dict.fromkeys(names, "no box above the threshold") | missing)

    def _boxes_by_camera(self, frames: Sequence[PreparedFrame], phrase: str) -> dict[str, list[Detection]]:
        return {frame.camera: kept_boxes(self.detector, frame, (phrase,), self.options) for frame in frames}


def _with_depth(frames: Sequence[RgbdFrame]) -> tuple[list[PreparedFrame], list[PreparedFrame]]:
    """Frames with any depth and frames without, all prepared.

    Raises:
        FrameError: No frame, or none with any depth.
    """
    if not frames:
        raise FrameError("there is no frame to look at; pass at least one RgbdFrame")
    ready = prepared(frames)
    blind = [frame for frame in ready if not frame.valid_depth.any()]
    seeing = [frame for frame in ready if frame.valid_depth.any()]
    if not seeing:
        raise FrameError(
            f"the frame of camera '{blind[0].camera}' at {blind[0].stamp:.3f} s has no valid depth at all; "
            "check that the camera delivers depth in metres (NaN or 0 where unknown) and take another frame"
        )
    return seeing, blind


@contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Adds the time spent within to a stage."""
    started = time.perf_counter()
    yield
    seconds[stage] += time.perf_counter() - started


def default_perception() -> Perception:
    """The embedded defaults: no network."""
    return perception_from_options()


def perception_from_options(
    detector: str = "default",
    segmenter: str = "default",
    options: PerceptionOptions | None = None,
    known: Mapping[str, KnownModel] | None = None,
    forms: Mapping[str, KnownForm] | None = None,
    catalogue: Catalogue | None = None,
) -> Perception:
    """Perception from two words or model names.

    Args:
        detector, segmenter: As in `perception.stages.selection`.
        options: How they run and what is kept; its defaults if None.
        known: Things whose shape is known beforehand, by name.
        forms: Things whose form is known up to its sizes, by noun.
        catalogue: What nouns and colours look like; the built-in one if None.

    Raises:
        ModelUnavailableError: The weights are not on this machine (and cannot be fetched), or of another kind. They
            are loaded at the first look only.
    """
    options = options or PerceptionOptions()
    return Perception(
        detector_of(detector, options, catalogue),
        segmenter_of(segmenter, options),
        options=options,
        known=dict(known or {}),
        forms=dict(forms or {}),
        catalogue=catalogue,
    )
