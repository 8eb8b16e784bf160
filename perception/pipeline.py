"""Frames and names in, scene estimate out: detect, suppress, segment, lift to points, fit, merge cameras."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from perception.errors import FrameError
from perception.estimates import Evidence, ObjectEstimate, SceneEstimate, Unseen
from perception.frames import RgbdFrame
from perception.interfaces import Detection, Detector, Segmenter
from perception.known_fit import KnownFit, KnownSettings, fit_known
from perception.known_models import KnownModel
from perception.looks import look_of
from perception.merging import merge
from perception.nms import suppress
from perception.pose import MaskedCloud, PoseSettings, fit_solid, masked_cloud
from perception.refine import Refined
from perception.shape_choice import kinds_of
from perception.solids import Solid
from perception.support import SupportPlane, estimate_support

STAGES = ("detect", "segment", "pose", "merge")


@dataclass(frozen=True)
class _View:
    """What one camera gave: estimates by name, and reasons by name."""

    found: dict[str, ObjectEstimate]
    missing: dict[str, str]


@dataclass(frozen=True)
class Perception:
    """A detector and a segmenter put to use.

    Attributes:
        detector: Draws boxes for phrases.
        segmenter: Turns boxes into masks.
        settings: Of the pose estimate.
        known: Things whose shape is known beforehand, by name. They are looked for by their shape in the depth of all
            cameras together; the detector is not asked for them.
    """

    detector: Detector
    segmenter: Segmenter
    settings: PoseSettings = field(default_factory=PoseSettings)
    known: Mapping[str, KnownModel] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def name(self) -> str:
        """Detector and segmenter, for people to read."""
        return f"{self.detector.name} + {self.segmenter.name}"

    def perceive(self, frames: Sequence[RgbdFrame], names: Sequence[str]) -> SceneEstimate:
        """Look for named things in pictures of one moment, taken by one or several cameras.

        Args:
            frames: At least one; each with `world_T_camera` in one common world whose z is up.
            names: Names such as "red_cube"; the phrase that is looked for is the name with spaces.

        Returns:
            One estimate per name that was seen (things seen by several cameras are merged), the others with reasons.
            A camera without any depth (a wrist camera close to something) is left out and named in `source`.

        Raises:
            FrameError: No frame, or none with any depth.
            UnknownPhraseError: A name that the detector has no way to look for.
            ModelUnavailableError: The detector's or segmenter's weights are not on this machine.
        """
        if not frames:
            raise FrameError("there is no frame to look at; pass at least one RgbdFrame")
        blind = [frame for frame in frames if not frame.valid_depth.any()]
        frames = [frame for frame in frames if frame.valid_depth.any()]
        if not frames:
            raise FrameError(
                f"the frame of camera '{blind[0].camera}' at {blind[0].stamp:.3f} s has no valid depth at all; "
                "check that the camera delivers depth in metres (NaN or 0 where unknown) and take another frame"
            )
        wanted = tuple(dict.fromkeys(name.strip().lower().replace(" ", "_") for name in names))
        seconds: dict[str, float] = dict.fromkeys(STAGES, 0.0)
        supports = [estimate_support(frame) for frame in frames]
        started = time.perf_counter()
        asked = [self.known[name] for name in wanted if name in self.known]
        table = next((s for s in supports if s.seen), supports[0])
        fits = fit_known(frames, asked, table, KnownSettings(self.settings.noise)) if asked else {}
        seconds["pose"] += time.perf_counter() - started
        standing = [fit for fit in fits.values() if isinstance(fit, KnownFit)]
        others = tuple(name for name in wanted if name not in fits)
        views = [
            self._look(frame, others, support, standing, seconds)
            for frame, support in zip(frames, supports, strict=True)
        ]
        started = time.perf_counter()
        objects, unseen = [], []
        for name in wanted:
            fit = fits.get(name)
            if isinstance(fit, KnownFit):
                objects.append(_known_estimate(fit, frames))
                continue
            if fit is not None:
                unseen.append(Unseen(name, fit))
                continue
            seen = [view.found[name] for view in views if name in view.found]
            if seen:
                objects.append(merge(seen))
            else:
                unseen.append(Unseen(name, "; ".join(dict.fromkeys(v.missing[name] for v in views))))
        seconds["merge"] += time.perf_counter() - started
        return SceneEstimate(
            objects=tuple(objects),
            unseen=tuple(unseen),
            support_height=float(np.median([s.height for s in supports if s.seen] or [0.0])),
            stamp=max(frame.stamp for frame in frames),
            source=self.name + "".join(f"; camera '{frame.camera}' has no depth" for frame in blind),
            seconds=seconds,
        )

    def _look(
        self,
        frame: RgbdFrame,
        names: tuple[str, ...],
        support: SupportPlane,
        standing: Sequence[KnownFit],
        seconds: dict[str, float],
    ) -> _View:
        """Everything one camera can say about what the detector finds; adds the time spent to `seconds`."""
        clock = time.perf_counter()
        phrases = {name.replace("_", " "): name for name in names}
        boxes = suppress(self.detector.detect(frame, tuple(phrases))) if phrases else []
        best: dict[str, Detection] = {}
        for box in boxes:
            best.setdefault(phrases[box.phrase], box)
        seconds["detect"] += time.perf_counter() - clock

        clock = time.perf_counter()
        masks = {n: self.segmenter.segment(frame, box.box_px, box.seed) for n, box in best.items()}
        _give_shared_pixels_to_the_smaller(masks)
        seconds["segment"] += time.perf_counter() - clock

        clock = time.perf_counter()
        missing = dict.fromkeys(names, "no box above the threshold")
        clouds: dict[str, MaskedCloud] = {}
        for name, mask in masks.items():
            cloud = masked_cloud(frame, mask, support, self.settings)
            if isinstance(cloud, str):
                missing[name] = cloud
            else:
                clouds[name] = cloud
        found: dict[str, ObjectEstimate] = {}
        solids: list[Solid] = [board for fit in standing for board in fit.model.carriers(fit.world_T_model)]
        vessels: list[Solid] = []
        # From the lowest upwards, so that what carries a thing is known before the thing.
        upwards = sorted(clouds, key=lambda n: clouds[n].lowest)
        for i, name in enumerate(upwards):
            cloud = clouds[name]
            above = np.zeros_like(cloud.mask)
            for other in upwards[i + 1 :]:
                above |= clouds[other].mask
            look = look_of(best[name].phrase)
            fitted = fit_solid(
                frame, cloud, kinds_of(look), support, solids, self.settings, above, vessels, look.equal_sides
            )
            (vessels if look.hollow else solids).append(fitted.solid)
            found[name] = self._estimate(frame, name, best[name], cloud, fitted)
        seconds["pose"] += time.perf_counter() - clock
        return _View(found, missing)

    def _estimate(
        self, frame: RgbdFrame, name: str, box: Detection, cloud: MaskedCloud, fitted: Refined
    ) -> ObjectEstimate:
        evidence = Evidence(frame.camera, box.box_px, cloud.mask, cloud.depth_share, self.name)
        return ObjectEstimate(
            name=name,
            phrase=box.phrase,
            world_T_object=fitted.solid.pose,
            extents=fitted.solid.extents,
            shape=fitted.solid.shape,
            position_std=fitted.position_std,
            yaw_std=fitted.yaw_std,
            score=float(np.clip(box.score, 0.0, 1.0)),
            stamp=frame.stamp,
            evidence=(evidence,),
            extents_std=fitted.extents_std,
        )


def _known_estimate(fit: KnownFit, frames: Sequence[RgbdFrame]) -> ObjectEstimate:
    """What was fitted to a known model, with the pixels that agree with it as evidence."""
    evidence = []
    for frame, mask in zip(frames, fit.masks(frames), strict=True):
        if mask.any():
            v, u = np.nonzero(mask)
            box = np.array([u.min(), v.min(), u.max() + 1, v.max() + 1], float)
            share = float(frame.valid_depth[mask].mean())
            evidence.append(Evidence(frame.camera, box, mask, share, "known shape"))
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
        evidence=tuple(evidence),
        joint_fractions=dict(zip(names, map(float, fit.fractions), strict=True)),
        joint_stds=dict(zip(names, map(float, fit.fraction_std), strict=True)),
        extents_std=np.zeros(3),
    )


def _give_shared_pixels_to_the_smaller(masks: dict[str, np.ndarray]) -> None:
    """Pixels that two masks claim go to the smaller mask: what stands on or in a thing hides it, not the reverse."""
    taken: np.ndarray | None = None
    for name in sorted(masks, key=lambda n: int(masks[n].sum())):
        if taken is None:
            taken = np.zeros_like(masks[name])
        masks[name] = masks[name] & ~taken
        taken = taken | masks[name]


def default_perception() -> Perception:
    """The embedded defaults: OpenCV only, no weights, no network."""
    from perception.colour_shape import ColourShapeDetector
    from perception.grabcut import GrabCutSegmenter

    return Perception(ColourShapeDetector(), GrabCutSegmenter())


def perception_from_options(
    detector: str = "colour",
    segmenter: str = "grabcut",
    offline: bool = False,
    known: Mapping[str, KnownModel] | None = None,
) -> Perception:
    """Perception from two words or model names.

    Args:
        detector: "colour", or a folder or hub name of a model for zero-shot detection such as
            "IDEA-Research/grounding-dino-tiny".
        segmenter: "grabcut", or a folder or hub name of a SAM or SAM 2 such as "facebook/sam-vit-base".
        offline: Never ask the hub; only folders and what earlier downloads left on this machine.
        known: Things whose shape is known beforehand, by name.

    Raises:
        ModelUnavailableError: Weights or packages are not on this machine; says the command that fetches them.
    """
    embedded = default_perception()
    chosen_detector: Detector = embedded.detector
    chosen_segmenter: Segmenter = embedded.segmenter
    if detector != "colour":
        from perception.hf_models import TransformersDetector

        chosen_detector = TransformersDetector(detector, offline=offline)
    if segmenter != "grabcut":
        from perception.hf_models import TransformersSegmenter

        chosen_segmenter = TransformersSegmenter(segmenter, offline=offline)
    return Perception(chosen_detector, chosen_segmenter, known=dict(known or {}))
