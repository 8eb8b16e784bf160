"""Held-out pictures of random cells with their truth: what detectors and poses are measured on, never trained on."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from perception.frames import RgbdFrame
from perception.ground_truth import FrameTruth
from perception.known_shapes.models import KnownModel
from sim_check.cells.simulation_config import DepthNoiseConfig
from sim_check.furniture.known_models import known_model
from sim_check.furniture.model import FurnitureModel
from sim_check.random_scenes.scenes import RandomScenes, SceneOptions, name_in, truth_of
from sim_check.world.depth_noise import stereo_depth

FIRST_SEED = 10_000_000  # training takes seeds below 1 000 000
DISTANCES = (0.5, 0.7, 1.0)  # [m] from the camera to the middle of the scene, in turn
CHUNK = 12  # frames of one seed: as many as one compiled pool gives
ABSENT = 3  # things that are not there are asked for as well, so many a frame
OPTIONS = SceneOptions(scenes_per_pool=6, views_per_scene=2)


@dataclass(frozen=True)
class HeldOutFrame:
    """One picture, what truly is in it, and what is asked.

    Attributes:
        frame: As a stereo camera delivers it.
        truth: What is there.
        names: What to look for: all that is clearly there, and some that is not.
        group: The camera's distance, for people.
        hinges_deg: By joint, how far its hinges turn from closed to open in [degrees].
        known: The shape of furniture that clearly shows, by name; where it stands and how open it is remains unknown.
    """

    frame: RgbdFrame
    truth: FrameTruth
    names: tuple[str, ...]
    group: str
    hinges_deg: Mapping[str, float]
    known: Mapping[str, KnownModel]


def held_out_frames(
    seed: int, chunk: int, count: int = CHUNK, options: SceneOptions = OPTIONS
) -> Iterator[HeldOutFrame]:
    """Frames of one chunk; they depend on seed and chunk alone.

    Args:
        seed: Of the whole set.
        chunk: Which part of it, from 0.
        count: Frames of it.
        options: What is drawn.

    Raises:
        MachineError: No way to render on this machine.
    """
    own = FIRST_SEED + 100_000 * seed + chunk
    rng = np.random.default_rng([own, 1])
    scenes = RandomScenes(own, options)
    try:
        for k in range(count):
            distance = DISTANCES[k % len(DISTANCES)]
            yield _frame(scenes, distance, f"{distance} m", float(k), options.depth_noise, rng)
    finally:
        scenes.close()


def _frame(
    scenes: RandomScenes,
    distance: float,
    group: str,
    stamp: float,
    noise: DepthNoiseConfig | None,
    rng: np.random.Generator,
) -> HeldOutFrame:
    picture = scenes.picture(distance)
    depth = picture.depth
    if noise is not None:
        depth = stereo_depth(depth, picture.intrinsics.fx, noise, rng)
    frame = RgbdFrame(picture.colour, depth, picture.intrinsics, picture.world_T_camera, stamp, "random")
    truth = truth_of(picture, scenes.catalogue)
    # Names are asked for in an order that says nothing about what is there.
    absent = rng.choice(truth.absent, min(ABSENT, len(truth.absent)), replace=False)
    names = rng.permutation([*(o.name for o in truth.objects), *absent])
    hinges = {
        part.name: float(np.degrees(part.opened))
        for s in picture.seen
        if isinstance(s.thing.model, FurnitureModel)
        for part in s.thing.model.parts
        if part.kind == "hinge"
    }
    things = [s.thing for s in picture.seen]
    known = {
        name: replace(known_model(s.thing.model), name=name)
        for s in picture.seen
        if s.clear and isinstance(s.thing.model, FurnitureModel) and (name := name_in(s.thing, things))
    }
    return HeldOutFrame(frame, truth, tuple(str(n) for n in names), group, hinges, known)
