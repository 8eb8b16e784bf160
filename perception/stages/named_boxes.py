"""Which boxes of a detector are kept in one picture, and which name each of them gets."""

from collections.abc import Sequence

from perception.detection.nms import suppress
from perception.frames import RgbdFrame
from perception.interfaces import Detection, Detector
from perception.options import PerceptionOptions
from perception.tracking.instances import instance_name


def kept_boxes(
    detector: Detector, frame: RgbdFrame, phrases: Sequence[str], options: PerceptionOptions
) -> list[Detection]:
    """What a detector finds, without boxes of what a better one has found already, best first.

    Raises:
        UnknownPhraseError, ModelUnavailableError: As `Detector.detect` does.
    """
    found = detector.detect(frame, tuple(phrases)) if phrases else []
    return suppress(found, options.same_phrase_iou, options.other_phrase_iou, options.most_per_phrase)


def named_boxes(boxes: Sequence[Detection], names: Sequence[str], instances: int) -> dict[str, Detection]:
    """The best boxes of each name: the best one is `name`, further ones are name_2, name_3, ...

    Args:
        boxes: Best first; their phrases are the names with spaces.
        names: What was asked for.
        instances: How many things one name may be.
    """
    of_phrase = {name.replace("_", " "): name for name in names}
    counts = dict.fromkeys(of_phrase, 0)
    best: dict[str, Detection] = {}
    for box in boxes:
        if counts[box.phrase] < instances:
            counts[box.phrase] += 1
            name = of_phrase[box.phrase]
            best[instance_name(name, {*names, *best}) if name in best else name] = box
    return best
