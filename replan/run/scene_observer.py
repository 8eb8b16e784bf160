"""Eyes of a run: frames from the cell's cameras, perceived, with pictures of what was seen."""

import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from perception.estimates import ObjectEstimate, SceneEstimate
from perception.geometry.prepared_frame import PreparedFrame, prepared
from perception.known_shapes.models import KnownModel
from perception.pictures import overlay
from perception.recordings.opening import save_npz
from perception.scene_file import LookRecord, PerceptionResult
from perception.tracking.unchanged import unchanged
from perception.unexplained.unnamed_things import Known, UnnamedThings
from replan.run.looked_into import LookedInto
from replan.run.session import RunSession
from sim_check.models.robot_region import RobotRegions

if TYPE_CHECKING:
    from perception.pipeline import Perception
    from replan.run.true_poses import TruePoses


class CameraSceneObserver:
    """Looks through every camera of the cell at once; furniture is looked for first where the last look saw it.

    Args:
        session: The run; its record gets one overlay picture per camera and look, and the raw frames, its film the
            first camera's overlay.
        perception: Detector, segmenter and geometry.
        furniture: Of known shape, by name, for telling what nobody named; None does not ask for that (true poses stand
            in for perception).

    Attributes:
        pictures: Colour pictures of the last look, uint8, shape (height, width, 3).
    """

    def __init__(
        self,
        session: RunSession,
        perception: "Perception | TruePoses",
        furniture: Mapping[str, KnownModel] | None,
    ) -> None:
        self._session = session
        self._perception = perception
        self._furniture = furniture
        self._before: SceneEstimate | None = None
        self._unnamed = UnnamedThings()
        self._robot = RobotRegions(session.cell.robot, session.cell.cameras)
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
        frames = prepared(self._session.client.frames())
        self.pictures = tuple(frame.colour for frame in frames)
        # Before perception, so that a frame on which it fails can be looked into.
        save_npz(self._session.episode.numbered("look", "npz"), frames)
        scene = self._perception.perceive(frames, (*names, *self._perception.known), self._before)
        still = self._before if anew is not None else None
        if still is not None:
            scene = unchanged(still, scene, anew or ())
        state = self._session.client.state()
        if self._furniture is not None:
            scene = self._with_unnamed(scene, frames, np.array(state.q), state.gripper_width, self._furniture)
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
                    "named": o.named,
                    "extents_std": o.extents_std,
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
        names = ", ".join(o.name for o in scene.objects if o.named) or "nothing"
        self._session.say(f"sees {names}{and_unnamed(scene)}" + (f" (not {unseen})" if unseen else ""))
        return scene

    def _with_unnamed(
        self,
        scene: SceneEstimate,
        frames: Sequence[PreparedFrame],
        q: np.ndarray,
        width: float,
        furniture: Mapping[str, KnownModel],
    ) -> SceneEstimate:
        """The scene with what nobody named; the arm rests during a look, so it is where it is measured now."""
        workspace = self._session.cell.workspace
        known = Known(np.array(workspace.low), np.array(workspace.high), self._robot.at(q, width), furniture)
        started = time.perf_counter()
        found = self._unnamed.added(scene, frames, known)
        return replace(found, seconds={**scene.seconds, "unnamed": time.perf_counter() - started})


def and_unnamed(scene: SceneEstimate) -> str:
    """What nobody named, for a sentence about what is seen; empty where there is nothing."""
    things = [o for o in scene.objects if not o.named]
    if not things:
        return ""
    count = "1 thing" if len(things) == 1 else f"{len(things)} things"
    return f", and {count} that nobody named: {', '.join(map(_place_of, things))}"


def _place_of(o: ObjectEstimate) -> str:
    sizes = " x ".join(f"{100 * e:.0f}" for e in o.extents)
    return f"{o.name} of {sizes} cm at x {o.position[0]:.2f}, y {o.position[1]:.2f} m"
