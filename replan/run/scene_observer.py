"""Eyes of a run: frames from the cell's cameras, perceived, with pictures of what was seen."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from perception.estimates import SceneEstimate
from perception.pictures import overlay
from perception.recordings.opening import save_npz
from perception.scene_file import LookRecord, PerceptionResult
from perception.tracking.unchanged import unchanged
from replan.run.looked_into import LookedInto
from replan.run.session import RunSession

if TYPE_CHECKING:
    from perception.pipeline import Perception
    from replan.run.true_poses import TruePoses


class CameraSceneObserver:
    """Looks through every camera of the cell at once; furniture is looked for first where the last look saw it.

    Args:
        session: The run; its record gets one overlay picture per camera and look, and the raw frames, its film the
            first camera's overlay.
        perception: Detector, segmenter and geometry.

    Attributes:
        pictures: Colour pictures of the last look, uint8, shape (height, width, 3).
    """

    def __init__(self, session: RunSession, perception: "Perception | TruePoses") -> None:
        self._session = session
        self._perception = perception
        self._before: SceneEstimate | None = None
        self._looked = LookedInto(session.cell)
        self._names: tuple[str, ...] = ()
        self.pictures: tuple[np.ndarray, ...] = ()

    def look_again(self, anew: Collection[str] = ()) -> SceneEstimate:
        """Look for the same names, where nothing but the arm has moved since: what was seen before still counts.

        Args:
            anew: Names that are seen better now, if they are seen; the others stay where they were seen before.

        Raises:
            PerceptionError, RobotGoneError: As for `look`.
        """
        with self._session.watch.part("perception"):
            return self._look(self._names, anew)

    def look(self, names: Sequence[str]) -> SceneEstimate:
        """Take fresh frames and find the named objects in them, and what is known to stand in the cell.

        Raises:
            PerceptionError: A frame cannot be used, or the detector cannot work at all.
            RobotGoneError: The cell does not answer.
        """
        with self._session.watch.part("perception"):
            return self._look(names)

    def _look(self, names: Sequence[str], anew: Collection[str] | None = None) -> SceneEstimate:
        import cv2

        self._names = tuple(names)
        frames = self._session.client.frames()
        self.pictures = tuple(frame.colour for frame in frames)
        # Before perception, so that a frame on which it fails can be looked into.
        save_npz(self._session.episode.numbered("look", "npz"), frames)
        scene = self._perception.perceive(frames, (*names, *self._perception.known), self._before)
        still = self._before if anew is not None else None
        if still is not None:
            scene = unchanged(still, scene, anew or ())
        state = self._session.client.state()
        seen = self._looked.after(frames, scene, np.array(state.q), state.gripper_width, still is not None)
        scene = replace(scene, seen=seen)
        self._before = scene
        cameras = "+".join(f.camera for f in frames)
        result = PerceptionResult(source=scene.source, frames=(LookRecord.of(scene, cameras),))
        result.write(self._session.episode.numbered("objects", "json"))
        for k, frame in enumerate(frames):
            picture = overlay(frame, scene)
            path = self._session.episode.numbered(f"look_{frame.camera}", "png")
            cv2.imwrite(str(path), picture[:, :, ::-1])
            if k == 0:
                self._session.film.stills.append((f"seen: {', '.join(scene.names) or 'nothing'}", picture))
        self._session.episode.log(
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
                    "doubts": o.doubts,
                }
                for o in scene.objects
            ],
            unseen=scene.unseen,
            share_seen=seen.share_seen,
        )
        unseen = "; ".join(f"{u.name}: {u.reason}" for u in scene.unseen)
        for o in scene.objects:
            if o.doubts:
                self._session.say(f"doubts {o.name}: {'; '.join(o.doubts)}")
        self._session.say(f"sees {', '.join(scene.names) or 'nothing'}" + (f" (not {unseen})" if unseen else ""))
        return scene
