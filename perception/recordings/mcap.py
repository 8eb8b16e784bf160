"""MCAP recordings of ROS 2 cameras: colour, registered depth, CameraInfo and the transforms up to a world.

The file is read twice: once for its topics and transforms, once frame by frame. No more than a chunk of the file and
the pictures that wait for their partners are held.
"""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from perception.errors import FrameError
from perception.frames import RgbdFrame
from perception.geometry.gravity_alignment import camera_above_plane
from perception.ground_truth import FrameTruth
from perception.recordings.base import Recording, Skipped, TruthOfFrame
from perception.recordings.intrinsics_file import IntrinsicsFile, read_intrinsics
from perception.recordings.mcap_cameras import CameraTopics, PictureTopic, find_cameras
from perception.recordings.mcap_choice import McapChoice
from perception.recordings.mcap_stream import McapStream, RosMessage
from perception.recordings.recorded_truth import LABELS_ENDING, TRUTH_TOPIC, RecordedTruth
from perception.ros2.camera_info import Lens, is_rectified, lens_of
from perception.ros2.images import colour_picture, depth_picture
from perception.ros2.messages import CAMERA_INFO, COMPRESSED, IMAGE, TF
from perception.ros2.stamp_pairs import Lonely, Stamped, StampPairs
from perception.ros2.transform_tree import TransformTree

TF_TOPIC, STATIC_TOPIC = "/tf", "/tf_static"
WORLDS = ("world", "map", "panda_link0", "fr3_link0", "base_link")  # frames that are taken for the world, in this order
TRUTHS_KEPT, LABELS_KEPT = 200, 20  # texts of truth and pictures of labels that wait for their frames


class McapRecording(Recording):
    """Cameras of one MCAP file.

    Args:
        path: The file.
        intrinsics: Intrinsics file that takes the place of CameraInfo.
        depth_scale: Metres per unit of depth of 16 bits; None for millimetres.
        choice: What to read.

    Raises:
        FrameError: No MCAP file, no camera in it, several topics that could be meant, nothing that says the intrinsics,
            or a world that no transform leads to.
    """

    def __init__(
        self,
        path: Path,
        intrinsics: Path | None = None,
        depth_scale: float | None = None,
        choice: McapChoice | None = None,
    ) -> None:
        self._choice = choice = choice or McapChoice()
        if not (math.isfinite(choice.tolerance) and choice.tolerance >= 0.0):
            raise FrameError(
                f"a tolerance of {choice.tolerance:g} s is not valid; it must be 0 or more, for instance 0.02"
            )
        self._lens_file: IntrinsicsFile | None = read_intrinsics(intrinsics) if intrinsics else None
        scale = depth_scale if depth_scale is not None else self._lens_file.depth_scale if self._lens_file else None
        self._scale = scale
        self._stream = McapStream(path)
        self._tree = TransformTree()
        self._pictures: dict[str, PictureTopic] = {}
        self._infos: dict[str, Any] = {}
        self._unread: dict[str, str] = {}  # of topics whose first messages could not be read
        self._first_look()
        try:
            self._cameras = find_cameras(self._pictures, self._infos, choice, self._lens_file is not None, self._unread)
            if depth_scale is not None:
                self._refuse_scale(depth_scale)
            self._world = self._find_world()
        except FrameError as error:
            raise FrameError(f"'{path}': {error}") from error
        super().__init__(path.name, None, self._notes(), TRUTH_TOPIC in self._topics)

    @property
    def cameras(self) -> tuple[CameraTopics, ...]:
        """The cameras that are read."""
        return self._cameras

    def _first_look(self) -> None:
        """Take in every transform, and the first readable message of each picture and CameraInfo topic."""
        self._topics = set(self._stream.topics)

        def wanted(topic: str, kind: str) -> bool:
            self._topics.add(topic)
            if kind == TF:
                return topic.endswith((TF_TOPIC, STATIC_TOPIC))
            if topic.endswith(LABELS_ENDING):
                return False
            return kind in (IMAGE, COMPRESSED, CAMERA_INFO) and topic not in self._pictures and topic not in self._infos

        for m in self._stream.messages(wanted):
            if isinstance(m, Skipped):
                self._unread.setdefault(m.where, m.reason)
                continue
            try:
                if m.kind == TF:
                    self._tree.add(m.content.transforms, m.topic.endswith(STATIC_TOPIC))
                elif m.kind == CAMERA_INFO:
                    self._infos[m.topic] = m.content
                else:
                    self._pictures[m.topic] = PictureTopic.of(m.topic, m.kind, m.content)
            except FrameError as error:  # the next message of the topic may be readable
                self._unread.setdefault(_where(m), str(error))

    def _refuse_scale(self, scale: float) -> None:
        if not (math.isfinite(scale) and scale > 0.0):
            raise FrameError(f"a depth scale of {scale:g} is not valid; it is metres per unit, for instance 0.001")
        said = [c.depth.topic for c in self._cameras if c.depth.in_metres]
        if said:
            raise FrameError(f"the depth of '{said[0]}' is in metres already; leave out --depth-scale")

    def _find_world(self) -> str | None:
        """Frame of the world: one that all cameras hang on, or None to make one from the plane that things stand on."""
        above = {c.name: [c.colour.frame, *self._tree.ancestors(c.colour.frame)] for c in self._cameras}
        if self._choice.world is not None:
            for camera, frames in above.items():
                if self._choice.world.lstrip("/") not in frames:
                    raise FrameError(
                        f"no transform leads from the world '{self._choice.world}' to camera '{camera}'; its frame "
                        f"hangs on {', '.join(frames)}; name one of them with --world"
                    )
            return self._choice.world
        return next((w for w in WORLDS if all(w in frames for frames in above.values())), None)

    def _notes(self) -> tuple[str, ...]:
        notes = [
            f"camera '{c.name}': {c.colour.topic} with {c.depth.topic}, {c.colour.size[0]}x{c.colour.size[1]}"
            for c in self._cameras
        ]
        notes += [
            f"camera '{c.name}': depth is of frame '{c.depth.frame}', colour of '{c.colour.frame}'; taken as registered"
            for c in self._cameras
            if c.depth.frame != c.colour.frame
        ]
        if self._world is not None:
            return (*notes, f"the world is the frame '{self._world}'")
        known = sorted({f for c in self._cameras for f in self._tree.ancestors(c.colour.frame)})
        why = (
            f"the cameras hang on {', '.join(known)}, none of {', '.join(WORLDS)}" if known else "it has no transforms"
        )
        return (*notes, f"the world's z = 0 is the plane that things stand on, found in each frame: {why}")

    def _items(self, with_truth: bool) -> Iterator[TruthOfFrame | Skipped]:
        of_topic = {c.colour.topic: (c, False) for c in self._cameras} | {
            c.depth.topic: (c, True) for c in self._cameras
        }
        pairs = {c.name: StampPairs(round(self._choice.tolerance * 1e9)) for c in self._cameras}
        infos, truths = dict(self._infos), _Truths()
        info_topics = {c.info for c in self._cameras}

        def wanted(topic: str, kind: str) -> bool:
            if with_truth and (topic == TRUTH_TOPIC or topic.endswith(LABELS_ENDING)):
                return True
            return topic in of_topic or topic in info_topics

        for m in self._stream.messages(wanted):
            if isinstance(m, Skipped):
                yield m
            elif m.topic == TRUTH_TOPIC or m.topic.endswith(LABELS_ENDING):
                wrong = truths.add(m)
                if wrong is not None:
                    yield wrong
            elif m.topic in info_topics:
                infos[m.topic] = m.content
            else:
                camera, is_depth = of_topic[m.topic]
                for found in pairs[camera.name].add(Stamped(_nanoseconds(m), m), is_depth):
                    yield self._frame(camera, infos, found, truths if with_truth else None)
        for camera in self._cameras:
            for found in pairs[camera.name].finish():
                yield self._frame(camera, infos, found, truths if with_truth else None)

    def _frame(
        self, camera: CameraTopics, infos: Mapping[str, Any], found: Any, truths: "_Truths | None"
    ) -> TruthOfFrame | Skipped:
        if isinstance(found, Lonely):
            what = "colour" if found.is_depth else "depth"
            far = "" if found.nearest is None else f"; the nearest is {found.nearest / 1e6:.1f} ms away"
            within = f"no {what} picture within {1000 * self._choice.tolerance:g} ms{far}"
            return Skipped(_where(found.what), within)
        message = found.colour
        try:
            colour = colour_picture(found.colour.content)
        except FrameError as error:
            return Skipped(_where(found.colour), str(error))
        try:
            message = found.depth
            depth = depth_picture(found.depth.content, self._scale)
            if depth.shape != colour.shape[:2]:
                raise FrameError(
                    f"depth is {depth.shape[1]}x{depth.shape[0]}, colour is {colour.shape[1]}x{colour.shape[0]}; "
                    "record depth registered to colour"
                )
            message = found.colour
            lens = self._lens(camera, infos)
            depth, colour = lens.straight_depth(depth), lens.straight_colour(colour)
            stamp = _nanoseconds(message)
            if self._world is not None:
                pose = self._tree.pose(self._world, message.content.header.frame_id, stamp / 1e9)
            elif self._lens_file is not None and self._lens_file.world_T_camera is not None:
                pose = np.array(self._lens_file.world_T_camera, float)
            else:
                pose = camera_above_plane(depth, lens.intrinsics)
            frame = RgbdFrame(colour, depth, lens.intrinsics, pose, stamp / 1e9, camera.name)
            return TruthOfFrame(frame, None if truths is None else truths.take(camera.name, stamp))
        except FrameError as error:
            return Skipped(_where(message), str(error))

    def _lens(self, camera: CameraTopics, infos: Mapping[str, Any]) -> Lens:
        if camera.info is None:
            assert self._lens_file is not None
            return Lens(self._lens_file.intrinsics)
        return lens_of(infos[camera.info], is_rectified(camera.colour.topic))


class _Truths:
    """Texts and pictures of labels that wait for their frames."""

    def __init__(self) -> None:
        self._texts: dict[tuple[str, int], RecordedTruth] = {}
        self._labels: dict[tuple[str, int], np.ndarray] = {}

    def add(self, message: RosMessage) -> Skipped | None:
        """Take in a message; what is wrong with it, if anything."""
        try:
            if message.topic == TRUTH_TOPIC:
                text = RecordedTruth.parse(message.content.data)
                self._texts[text.camera, text.stamp_ns] = text
            else:
                camera = message.topic.removesuffix(LABELS_ENDING).split("/")[-1]
                m = message.content
                if m.encoding != "mono16" or len(m.data) != 2 * m.width * m.height:
                    raise FrameError("a picture of labels is mono16 without padding")
                labels = np.frombuffer(m.data, ">u2" if m.is_bigendian else "<u2").reshape(m.height, m.width)
                self._labels[camera, _nanoseconds(message)] = labels
        except FrameError as error:
            return Skipped(_where(message), str(error))
        for waiting, most in ((self._texts, TRUTHS_KEPT), (self._labels, LABELS_KEPT)):
            while len(waiting) > most:
                del waiting[next(iter(waiting))]
        return None

    def take(self, camera: str, stamp: int) -> FrameTruth | None:
        """The truth of a frame, which nobody asks for again."""
        labels, text = self._labels.pop((camera, stamp), None), self._texts.pop((camera, stamp), None)
        return None if text is None else text.truth(labels)


def _nanoseconds(message: RosMessage) -> int:
    stamp = message.content.header.stamp
    return stamp.sec * 10**9 + stamp.nanosec


def _where(message: RosMessage) -> str:
    return f"message {message.number} of topic '{message.topic}'"
