"""Frames and names in, scene estimate out: detect, suppress, segment, lift to points, fit, merge cameras."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from perception.catalogue.catalogue import Catalogue
from perception.catalogue.colour_words import colour_of
from perception.catalogue.phrases import appearance_of
from perception.detection import bundled
from perception.detection.detector_router import DetectorRouter
from perception.detection.model_files import DETECTOR, SEGMENTER, find_model
from perception.detection.nms import box_iou, suppress
from perception.detection.shape_conflicts import contradicted
from perception.errors import FrameError, ModelUnavailableError
from perception.estimates import Evidence, ObjectEstimate, SceneEstimate, Unseen
from perception.frames import RgbdFrame
from perception.geometry.pose import MaskedCloud, PoseSettings, fit_solid, masked_cloud
from perception.geometry.refinement import Refined
from perception.geometry.shape_choice import kinds_of
from perception.geometry.solids import Solid
from perception.geometry.stacks import own_pixels, whole_stack
from perception.geometry.support import SupportPlane, estimate_support
from perception.interfaces import Detection, Detector, Segmenter, ShapeDetector
from perception.known_shapes.articulated_fit import KnownFit, KnownSettings, fit_known
from perception.known_shapes.form_fit import FormSettings
from perception.known_shapes.form_search import find_forms, forms_of
from perception.known_shapes.forms import KnownForm
from perception.known_shapes.models import KnownModel
from perception.options import PerceptionOptions
from perception.tracking.instances import group_by_thing, instance_name
from perception.tracking.merging import merge

# Sides of a thing of a known form against its usual ones, shortest with shortest: partly hidden, or a big one.
LEAST_SHARE, MOST_SHARE = 0.4, 1.5
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
            frames: At least one; each with `world_T_camera` in one common world whose z is up.
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
        stood = _stood(asked, before)
        fits = fit_known(frames, asked, table, KnownSettings(self.settings.noise), stood) if asked else {}
        standing = [fit for fit in fits.values() if isinstance(fit, KnownFit)]
        of_form = forms_of([name for name in wanted if name not in fits], self.forms)
        search = FormSettings(self.settings.noise)
        formed = find_forms(frames, of_form, table, standing, search, self.catalogue) if of_form else {}
        seconds["pose"] += time.perf_counter() - started
        formed = {name: self._likeliest(seen, frames) for name, seen in formed.items() if seen}
        others = tuple(name for name in wanted if name not in fits and name not in formed)
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
            if name in formed:
                objects += formed[name]
                continue
            phrase = name.replace("_", " ")
            seen = [[o for o in view.found.values() if o.phrase == phrase] for view in views]
            against = self._contradicted(phrase, [o for view in seen for o in view], frames)
            if against:
                unseen.append(Unseen(name, against))
                continue
            # One name for one thing: what disagrees is a mistake, which `merge` leaves out.
            groups = group_by_thing(seen) if self.instances > 1 else [[o for view in seen for o in view]]
            merges = [merge(group) for group in groups[: self.instances]] if any(seen) else []
            if name in of_form:
                merges = [m for m in merges if _may_have(of_form[name], m)]
                if any(seen) and not merges:
                    unseen.append(Unseen(name, "what looks like it in the pictures has not its sizes"))
            for i, merged in enumerate(merges):
                free = instance_name(name, {*wanted, *(o.name for o in objects)}) if i else name
                objects.append(replace(merged, name=free, colour=colour_of(merged.evidence, frames, self.catalogue)))
            if not any(seen):
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

    def _contradicted(self, phrase: str, seen: Sequence[ObjectEstimate], frames: Sequence[RgbdFrame]) -> str | None:
        """Why something is not of the shape that its noun says; None where nothing speaks against it."""
        if self.instances > 1 or len(frames) < 2 or not isinstance(self.detector, ShapeDetector):
            return None
        return contradicted(phrase, seen, frames, self.detector)

    def _likeliest(self, seen: Sequence[ObjectEstimate], frames: Sequence[RgbdFrame]) -> list[ObjectEstimate]:
        """At most `instances` of the things that have a form; if there are more, those that the detector finds best."""
        if len(seen) > self.instances:
            boxes = {frame.camera: self._boxes(frame, (seen[0].phrase,)) for frame in frames}

            def liking(thing: ObjectEstimate) -> float:
                pairs = [(e, box) for e in thing.evidence for box in boxes[e.camera]]
                return sum(box.score * float(box_iou(e.box_px, box.box_px)[0, 0]) for e, box in pairs)

            seen = sorted(seen, key=liking, reverse=True)[: self.instances]
        names: list[str] = []
        for thing in seen:
            names.append(instance_name(thing.name, names))
        return [replace(thing, name=name) for thing, name in zip(seen, names, strict=True)]

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
        boxes = self._boxes(frame, tuple(phrases)) if phrases else []
        best: dict[str, Detection] = {}
        counts = dict.fromkeys(phrases, 0)
        for box in boxes:
            if counts[box.phrase] < self.instances:
                counts[box.phrase] += 1
                name = phrases[box.phrase]
                best[instance_name(name, {*names, *best}) if name in best else name] = box
        seconds["detect"] += time.perf_counter() - clock

        clock = time.perf_counter()
        masks = dict(zip(best, self._masks(frame, list(best.values())), strict=True))
        _give_shared_pixels_to_the_smaller(masks)
        seconds["segment"] += time.perf_counter() - clock

        clock = time.perf_counter()
        missing = dict.fromkeys(names, "no box above the threshold")
        clouds: dict[str, MaskedCloud] = {}
        for name, mask in masks.items():
            cloud = masked_cloud(frame, mask, support, self.settings, best[name].behind)
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
            look = appearance_of(best[name].phrase, self.catalogue)
            fitted = fit_solid(
                frame, cloud, kinds_of(look), support, solids, self.settings, above, vessels, look.equal_sides
            )
            (vessels if look.hollow else solids).append(fitted.solid)
            found[name] = self._estimate(frame, name, best[name], cloud, fitted)
        seconds["pose"] += time.perf_counter() - clock
        return _View(found, missing)

    def _masks(self, frame: RgbdFrame, boxes: Sequence[Detection]) -> list[np.ndarray]:
        """One mask a box; things of one look that stand on each other are cut out together, then told apart."""
        wholes = [box if box.rest is None else whole_stack(box) for box in boxes]
        corners = np.array([box.box_px for box in wholes]).reshape(-1, 4)
        cut = self.segmenter.segment_all(frame, corners, [box.seed for box in wholes])
        return [
            mask if box.rest is None or box.seed is None else own_pixels(mask, box.seed, box.rest)
            for mask, box in zip(cut, boxes, strict=True)
        ]

    def _boxes(self, frame: RgbdFrame, phrases: tuple[str, ...]) -> list[Detection]:
        """What the detector found, without boxes of what a better one has found already."""
        options = self.options
        return suppress(
            self.detector.detect(frame, phrases),
            options.same_phrase_iou,
            options.other_phrase_iou,
            options.most_per_phrase,
        )

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


def _may_have(form: KnownForm, seen: ObjectEstimate) -> bool:
    """Whether something of these sizes, a part of it maybe hidden, can be of a form."""
    shares = np.sort(np.asarray(seen.extents)) / np.sort(np.asarray(form.extents))
    return bool(shares.min() >= LEAST_SHARE and shares.max() <= MOST_SHARE)


def _stood(models: Sequence[KnownModel], before: SceneEstimate | None) -> dict[str, np.ndarray]:
    """Place, turn and fractions of those models that an earlier look saw, by name."""
    seen = [(model, before.get(model.name)) for model in models] if before else []
    return {
        model.name: np.array([*o.position[:2], o.yaw, *(o.joint_fractions.get(p.name, 0.0) for p in model.parts)])
        for model, o in seen
        if o is not None
    }


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
        detector: "default", "colour", "bundled", or a folder or hub name of a model for zero-shot detection such as
            "IDEA-Research/grounding-dino-tiny".
        segmenter: "default", "grabcut", "bundled", or a folder or hub name of a SAM or SAM 2 such as
            "facebook/sam-vit-base".
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
        _detector(detector, options, catalogue),
        _segmenter(segmenter, options),
        options=options,
        known=dict(known or {}),
        forms=dict(forms or {}),
        catalogue=catalogue,
    )


def _detector(name: str, options: PerceptionOptions, catalogue: Catalogue | None) -> Detector:
    if name == "default":
        colour = _detector("colour", options, catalogue)
        try:
            learned = _bundled_detector(options)
        except ModelUnavailableError:  # a package without weights; the name says that colour is all there is
            return colour
        return DetectorRouter(colour, learned, learned.known_words, catalogue)
    if name == "colour":
        from perception.detection.colour_shape import ColourShapeDetector, ColourShapeSettings

        settings = ColourShapeSettings()
        if options.threshold is not None:
            settings = replace(settings, threshold=options.threshold)
        return ColourShapeDetector(settings, catalogue)
    if name == "bundled":
        return _bundled_detector(options)
    from perception.detection.hf_models import THRESHOLD, TransformersDetector

    find_model(name, DETECTOR, options.offline)  # now, so that a wrong name does not wait for the first look
    return TransformersDetector(
        name,
        offline=options.offline,
        threshold=THRESHOLD if options.threshold is None else options.threshold,
        device=options.device,
        precision=options.precision,
    )


def _bundled_detector(options: PerceptionOptions) -> bundled.BundledDetector:
    return bundled.BundledDetector(bundled.DETECTOR_FOLDER, options.threshold, options.device, options.precision)


def _segmenter(name: str, options: PerceptionOptions) -> Segmenter:
    name = bundled.DEFAULT_SEGMENTER if name == "default" else name
    if name == "grabcut":
        from perception.detection.grabcut import GrabCutSegmenter

        return GrabCutSegmenter()
    if name == "bundled":
        return bundled.bundled_segmenter(bundled.SEGMENTER_FOLDER, options.device, options.precision)
    from perception.detection.crop_segmenter import CropSegmenter, read_crop_settings
    from perception.detection.hf_models import TransformersSegmenter

    folder = find_model(name, SEGMENTER, options.offline)
    crops = read_crop_settings(folder)
    if crops is not None:
        return CropSegmenter(folder, crops, options.device, options.precision)
    return TransformersSegmenter(name, options.offline, options.device, options.precision)
