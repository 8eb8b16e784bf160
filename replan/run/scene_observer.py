"""Eyes of a run: frames from the cell's cameras, perceived, with pictures of what was seen."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from perception.estimates import SceneEstimate
from perception.pictures import overlay
from perception.recordings.opening import save_npz
from perception.scene_file import LookRecord, PerceptionResult
from replan.run.episode import Episode
from replan.run.film import Film
from replan.run.stopwatch import Stopwatch

if TYPE_CHECKING:
    from hw_interface.cell.client import CellClient
    from perception.pipeline import Perception
    from replan.run.true_poses import TruePoses


class CameraSceneObserver:
    """Looks through every camera of the cell at once; furniture is looked for first where the last look saw it.

    Args:
        client: Connection to the cell.
        perception: Detector, segmenter and geometry.
        episode: Record of the run; gets one overlay picture per camera and look, and the raw frames.
        film: Gets the first camera's overlay as a still.
        say: Progress for people.
        watch: Shares out the run's time.
    """

    def __init__(
        self,
        client: "CellClient",
        perception: "Perception | TruePoses",
        episode: Episode,
        film: Film,
        say: Callable[[str], None],
        watch: Stopwatch,
    ) -> None:
        self._client = client
        self._perception = perception
        self._episode = episode
        self._film = film
        self._say = say
        self._watch = watch
        self._before: SceneEstimate | None = None
        self.pictures: tuple[np.ndarray, ...] = ()  # colour pictures of the last look, uint8, (h, w, 3)

    def look(self, names: Sequence[str]) -> SceneEstimate:
        """Take fresh frames and find the named objects in them, and what is known to stand in the cell.

        Raises:
            PerceptionError: A frame cannot be used, or the detector cannot work at all.
            RobotGoneError: The cell does not answer.
        """
        with self._watch.part("perception"):
            return self._look(names)

    def _look(self, names: Sequence[str]) -> SceneEstimate:
        import cv2

        frames = self._client.frames()
        self.pictures = tuple(frame.colour for frame in frames)
        # Before perception, so that a frame on which it fails can be looked into.
        save_npz(self._episode.numbered("look", "npz"), frames)
        scene = self._perception.perceive(frames, (*names, *self._perception.known), self._before)
        self._before = scene
        cameras = "+".join(f.camera for f in frames)
        result = PerceptionResult(source=scene.source, frames=(LookRecord.of(scene, cameras),))
        result.write(self._episode.numbered("objects", "json"))
        for k, frame in enumerate(frames):
            picture = overlay(frame, scene)
            path = self._episode.numbered(f"look_{frame.camera}", "png")
            cv2.imwrite(str(path), picture[:, :, ::-1])
            if k == 0:
                self._film.stills.append((f"seen: {', '.join(scene.names) or 'nothing'}", picture))
        self._episode.log(
            "look",
            cameras=[f.camera for f in frames],
            source=scene.source,
            stamp=scene.stamp,
            seconds=scene.seconds,
            objects=[
                {
                    "name": o.name,
                    "position": o.position,
                    "yaw": o.yaw,
                    "extents": o.extents,
                    "shape": o.shape,
                    "position_std": o.position_std,
                    "joint_fractions": o.joint_fractions,
                    "score": o.score,
                }
                for o in scene.objects
            ],
            unseen=scene.unseen,
        )
        unseen = "; ".join(f"{u.name}: {u.reason}" for u in scene.unseen)
        self._say(f"sees {', '.join(scene.names) or 'nothing'}" + (f" (not {unseen})" if unseen else ""))
        return scene
