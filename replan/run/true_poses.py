"""True poses in place of perceived ones: what the benchmark compares perception with.

Only what a camera of the cell truly shows has a pose, so that what furniture hides stays unseen. It works with a
simulated cell that was started for scoring, and with no other.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

import numpy as np

from perception.catalogue.phrases import appearance_of
from perception.estimates import Evidence, ObjectEstimate, SceneEstimate, Shape, Unseen
from perception.frames import RgbdFrame
from perception.ground_truth import FrameTruth, TrueObject

SEEN_PIXELS = 60  # [px] in one camera; about what perception needs for a pose
EXACT = 2e-4  # [m] and [rad]; spreads of what is known exactly, so that none is zero


class TruthTeller(Protocol):
    """A connection to a cell that is scored, or a simulated world in this process."""

    def frame_truth(self, camera: str, /) -> FrameTruth:
        """What truly is in a camera's picture of now."""
        ...


class TruePoses:
    """Stands in for `perception.pipeline.Perception`.

    Args:
        truth: Says what the cameras truly show.
        furniture: Names of what stands fixed and is always looked for.
    """

    name = "true poses of what is in view"

    def __init__(self, truth: TruthTeller, furniture: Sequence[str]) -> None:
        self._truth = truth
        self.known: Mapping[str, None] = MappingProxyType(dict.fromkeys(furniture))

    def perceive(
        self, frames: Sequence[RgbdFrame], names: Sequence[str], before: SceneEstimate | None = None
    ) -> SceneEstimate:
        """The true poses of the named things that the frames' cameras show now, whatever was seen before.

        Raises:
            RobotGoneError: The cell does not answer scorers.
        """
        shown: dict[str, list[tuple[RgbdFrame, TrueObject]]] = {}
        for frame in frames:
            for thing in self._truth.frame_truth(frame.camera).objects:
                assert thing.mask is not None  # a simulated cell always says
                if thing.mask.sum() >= SEEN_PIXELS:
                    shown.setdefault(thing.name, []).append((frame, thing))
        wanted = tuple(dict.fromkeys(name.strip().lower().replace(" ", "_") for name in names))
        return SceneEstimate(
            objects=tuple(_estimate(shown[name]) for name in wanted if name in shown),
            unseen=tuple(Unseen(name, "no camera truly shows it") for name in wanted if name not in shown),
            support_height=0.0,
            stamp=max(frame.stamp for frame in frames),
            source=self.name,
        )


def _estimate(views: Sequence[tuple[RgbdFrame, TrueObject]]) -> ObjectEstimate:
    thing = views[0][1]
    assert thing.extents is not None
    shape = thing.shape or _solid_of(thing.name)
    return ObjectEstimate(
        name=thing.name,
        phrase=thing.name.replace("_", " "),
        world_T_object=thing.world_T_object,
        extents=thing.extents,
        shape=shape,
        position_std=np.full(3, EXACT),
        yaw_std=EXACT if shape == "box" else np.inf,
        score=1.0,
        stamp=max(frame.stamp for frame, _ in views),
        evidence=tuple(_evidence(frame, seen) for frame, seen in views),
        # A simulated joint may stand a hair beyond its ends.
        joint_fractions={name: min(1.0, max(0.0, f)) for name, f in thing.joint_fractions.items()},
        joint_stds=dict.fromkeys(thing.joint_fractions, EXACT),
        extents_std=np.full(3, EXACT),
    )


def _solid_of(name: str) -> Shape:
    """The solid that perception fits to a thing of several solids, such as a bowl."""
    return appearance_of(name.replace("_", " ")).solid


def _evidence(frame: RgbdFrame, thing: TrueObject) -> Evidence:
    assert thing.mask is not None and thing.box_px is not None
    share = float(frame.valid_depth[thing.mask].mean())
    return Evidence(frame.camera, thing.box_px, thing.mask, share, TruePoses.name)
