"""Which topics of a ROS 2 recording are a camera: a colour picture, a depth picture registered to it, a CameraInfo.

Colour and depth belong together when they are of the same frame and size. Where several fit, names decide, as drivers
of RealSense, ZED and Kinect cameras give them; what they do not decide is asked for.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from perception.errors import FrameError
from perception.recordings.mcap_choice import McapChoice
from perception.ros2.images import is_depth, is_in_metres, picture_size
from perception.ros2.messages import CAMERA_INFO, IMAGE

UNREAD_NAMED = 3  # of the messages that cannot be read
COMPRESSED_ENDINGS = ("/compressed", "/compressedDepth")
# Words of topics that hold the wanted picture, the best first; then words of those that are something else.
COLOUR_WORDS, OTHER_COLOUR = ("rgb", "color", "colour", "left"), ("infra", "/ir/", "right", "gray")
DEPTH_WORDS, OTHER_DEPTH = ("aligned_depth", "depth_registered", "depth"), ("confidence", "disparity")


@dataclass(frozen=True)
class PictureTopic:
    """What the first readable message of a topic shows.

    Attributes:
        topic, kind: Its name and type.
        depth: Whether it is depth; None where it is neither depth nor colour.
        frame: Frame in which it was taken.
        size: (width, height) in [px].
        in_metres: Whether it is depth that says its unit.
    """

    topic: str
    kind: str
    depth: bool | None
    frame: str
    size: tuple[int, int]
    in_metres: bool

    @classmethod
    def of(cls, topic: str, kind: str, message: Any) -> "PictureTopic":
        """From a message.

        Raises:
            FrameError: A compressed picture that cannot be read.
        """
        depth = is_depth(message)
        size = picture_size(message)
        return cls(topic, kind, depth, message.header.frame_id.lstrip("/"), size, bool(depth) and is_in_metres(message))

    @property
    def label(self) -> str:
        """For messages: topic, type, size and frame."""
        what = {True: "depth", False: "colour", None: "other"}[self.depth]
        return f"'{self.topic}' ({self.kind}, {what} {self.size[0]}x{self.size[1]} in frame '{self.frame}')"


@dataclass(frozen=True)
class CameraTopics:
    """One camera.

    Attributes:
        name: The part that its topics share, its last folder where that is enough to tell it from the others.
        colour, depth: Its pictures.
        info: Topic of its CameraInfo, or None where an intrinsics file takes its place.
    """

    name: str
    colour: PictureTopic
    depth: PictureTopic
    info: str | None


def find_cameras(
    pictures: Mapping[str, PictureTopic],
    infos: Mapping[str, Any],
    choice: McapChoice,
    has_intrinsics: bool,
    unread: Mapping[str, str],
) -> tuple[CameraTopics, ...]:
    """The cameras of a recording.

    Args:
        pictures: By topic.
        infos: First CameraInfo by topic.
        choice: What the user named.
        has_intrinsics: Whether an intrinsics file takes the place of CameraInfo.
        unread: What could not be read and why, for messages.

    Raises:
        FrameError: There is none, several fit, or a topic that was named is not there; lists the topics.
    """
    has = f"it has {'; '.join(p.label for p in pictures.values()) or 'no pictures'}" + "".join(
        f"; '{topic}' ({CAMERA_INFO})" for topic in infos
    )
    has += "".join(f"; {where}: {reason}" for where, reason in list(unread.items())[:UNREAD_NAMED])
    for option, named, known in (
        ("--colour-topic", choice.colour, pictures),
        ("--depth-topic", choice.depth, pictures),
        ("--info-topic", choice.info, infos),
    ):
        if named is not None and named not in known:
            raise FrameError(f"there is no topic '{named}' for {option} with a message that can be read; {has}")
    pairs = _pairs(pictures, choice, has)
    names = _names([(c.topic, d.topic) for c, d in pairs])
    cameras = []
    for name, (colour, depth) in zip(names, pairs, strict=True):
        if choice.cameras and name not in choice.cameras:
            continue
        cameras.append(CameraTopics(name, colour, depth, _info(colour, infos, choice, has_intrinsics, has)))
    missing = [n for n in choice.cameras if n not in names]
    if missing:
        raise FrameError(f"there is no camera '{missing[0]}'; there are {', '.join(names)}")
    return tuple(cameras)


def _pairs(
    pictures: Mapping[str, PictureTopic], choice: McapChoice, has: str
) -> list[tuple[PictureTopic, PictureTopic]]:
    colours = [p for p in pictures.values() if p.depth is False]
    depths = [p for p in pictures.values() if p.depth]
    for option, named, of_kind in (("colour", choice.colour, colours), ("depth", choice.depth, depths)):
        if named is not None and pictures[named] not in of_kind:
            raise FrameError(f"the topic {pictures[named].label} is no {option} picture; {has}")
    if choice.colour is not None and choice.depth is not None:
        colour, depth = pictures[choice.colour], pictures[choice.depth]
        if colour.size != depth.size:
            raise FrameError(f"colour and depth differ in size: {colour.label}, {depth.label}; {_REGISTER}")
        return [(colour, depth)]
    colours = [c for c in colours if choice.colour in (None, c.topic)]
    depths = [d for d in depths if choice.depth in (None, d.topic)]
    if not colours or not depths:
        raise FrameError(f"there is no {'colour' if not colours else 'depth'} picture in the recording; {has}")
    groups: dict[tuple[str, tuple[int, int]], tuple[list[PictureTopic], list[PictureTopic]]] = {}
    for p in (*colours, *depths):
        groups.setdefault((p.frame, p.size), ([], []))[bool(p.depth)].append(p)
    whole = [(c, d) for c, d in groups.values() if c and d]
    if not whole:
        raise FrameError(f"no depth is of the same frame and size as a colour picture: {has}; {_REGISTER}")
    best = [
        (_best(c, COLOUR_WORDS, OTHER_COLOUR, "--colour-topic"), _best(d, DEPTH_WORDS, OTHER_DEPTH, "--depth-topic"))
        for c, d in whole
    ]
    # The infrared picture of a depth camera makes a camera only where there is no other.
    return [(c, d) for c, d in best if not any(w in c.topic.lower() for w in OTHER_COLOUR)] or best


_REGISTER = (
    "record depth registered to colour (for a RealSense camera align_depth.enable:=true), or name both topics with "
    "--colour-topic and --depth-topic"
)


def _best(topics: list[PictureTopic], words: tuple[str, ...], others: tuple[str, ...], option: str) -> PictureTopic:
    """The one of several topics of the same frame whose name fits best.

    Raises:
        FrameError: Several fit equally.
    """

    def rank(p: PictureTopic) -> tuple[bool, int, bool, bool]:
        name = p.topic.lower()
        fits = next((k for k, w in enumerate(words) if w in name), len(words))
        return any(w in name for w in others), fits, "raw" in name and "rect" not in name, p.kind != IMAGE

    ordered = sorted(topics, key=rank)
    equal = [p for p in ordered if rank(p) == rank(ordered[0])]
    if len(equal) > 1:
        raise FrameError(f"several topics fit: {'; '.join(p.label for p in equal)}; choose one with {option}")
    return ordered[0]


def _names(pairs: list[tuple[str, str]]) -> list[str]:
    """A name for each camera, from what its topics share."""
    shared = [os.path.commonpath(topics).strip("/") or topics[0].strip("/").split("/")[0] for topics in pairs]
    short = [s.split("/")[-1] for s in shared]
    names = short if len(set(short)) == len(short) else [s.replace("/", "_") for s in shared]
    return [n if names.count(n) == 1 else f"{n}_{k}" for k, n in enumerate(names)]


def _info(
    colour: PictureTopic, infos: Mapping[str, Any], choice: McapChoice, has_intrinsics: bool, has: str
) -> str | None:
    if choice.info is not None:
        return choice.info
    if has_intrinsics:
        return None
    base = colour.topic
    for ending in COMPRESSED_ENDINGS:
        base = base.removesuffix(ending)
    beside = f"{base.rsplit('/', 1)[0]}/camera_info"
    if beside in infos:
        return beside
    of_frame = [
        t
        for t, i in infos.items()
        if i.header.frame_id.lstrip("/") == colour.frame and (i.width, i.height) == colour.size
    ]
    if len(of_frame) == 1:
        return of_frame[0]
    raise FrameError(
        f"nothing says the intrinsics of {colour.label}: '{beside}' ({CAMERA_INFO}) is not in the recording; name one "
        f"with --info-topic, or say --intrinsics with a file of width, height, fx, fy, cx, cy; {has}"
    )
