"""Which detector and which segmenter a word or a model's name means."""

from dataclasses import replace

from perception.catalogue.catalogue import Catalogue
from perception.detection import bundled
from perception.detection.detector_router import DetectorRouter
from perception.detection.model_files import DETECTOR, SEGMENTER, find_model
from perception.errors import ModelUnavailableError
from perception.interfaces import Detector, Segmenter
from perception.options import PerceptionOptions


def detector_of(name: str, options: PerceptionOptions, catalogue: Catalogue | None = None) -> Detector:
    """A detector from a word or a model's name.

    Args:
        name: "default", "colour", "bundled", or a folder or hub name of a model for zero-shot detection such as
            "IDEA-Research/grounding-dino-tiny".
        options: How it runs.
        catalogue: What nouns and colours look like; the built-in one if None.

    Raises:
        ModelUnavailableError: The weights are not on this machine (and cannot be fetched), or of another kind. They
            are loaded at the first look only.
    """
    if name == "default":
        colour = detector_of("colour", options, catalogue)
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
    from perception.detection.hf_detector import THRESHOLD, TransformersDetector

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


def segmenter_of(name: str, options: PerceptionOptions) -> Segmenter:
    """A segmenter from a word or a model's name.

    Args:
        name: "default", "grabcut", "bundled", or a folder or hub name of a SAM or SAM 2 such as
            "facebook/sam-vit-base".
        options: How it runs.

    Raises:
        ModelUnavailableError: As `detector_of` does.
    """
    name = bundled.DEFAULT_SEGMENTER if name == "default" else name
    if name == "grabcut":
        from perception.detection.grabcut import GrabCutSegmenter

        return GrabCutSegmenter()
    if name == "bundled":
        return bundled.bundled_segmenter(bundled.SEGMENTER_FOLDER, options.device, options.precision)
    from perception.detection.crop_segmenter import CropSegmenter, read_crop_settings
    from perception.detection.hf_segmenter import TransformersSegmenter

    folder = find_model(name, SEGMENTER, options.offline)
    crops = read_crop_settings(folder)
    if crops is not None:
        return CropSegmenter(folder, crops, options.device, options.precision)
    return TransformersSegmenter(name, options.offline, options.device, options.precision)
