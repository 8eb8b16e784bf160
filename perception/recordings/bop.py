"""Scene folders of BOP data sets (Benchmark for 6D Object Pose, https://bop.felk.cvut.cz): frames and their truth.

    scene_camera.json     cam_K, depth_scale ([mm] per unit), cam_R_w2c and cam_t_w2c ([mm]) where the world is known
    rgb/ or gray/         000000.png or .jpg
    depth/                000000.png, 16 bits, 0 where unknown
    scene_gt.json         obj_id, cam_R_m2c, cam_t_m2c ([mm]) of each object; for scorers
    scene_gt_info.json    visib_fract of each object; for scorers
    mask_visib/           000000_000000.png, the visible pixels of each object; for scorers

The pose of a model in the world is  world_T_model = world_T_camera camera_T_model ; things here have their box's centre
as origin, so the centre of the model's box is added. Without cam_R_w2c the world's z = 0 is the plane that things stand
on (`perception.geometry.gravity_alignment`).
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from perception.depth_units import checked_scale, depth_in_metres
from perception.errors import FrameError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.geometry.gravity_alignment import camera_above_plane
from perception.ground_truth import FrameTruth, TrueObject, box_around
from perception.recordings.base import Recording, Skipped, TruthOfFrame
from perception.recordings.bop_models import (
    MM,
    BopModel,
    find_models,
    find_names,
    name_of,
    read_json,
    read_models,
    read_names,
)
from perception.recordings.png import first_depth, read_picture

CAMERA_FILE, TRUTH_FILE, INFO_FILE = "scene_camera.json", "scene_gt.json", "scene_gt_info.json"
COLOUR_FOLDERS, COLOUR_ENDINGS = ("rgb", "gray"), (".png", ".jpg", ".jpeg", ".tif")
LEAST_PIXELS = 10  # [px]; an object that shows less is not asked for


class BopScene(Recording):
    """One scene folder.

    Args:
        folder: The folder.
        depth_scale: Metres per unit of the depth pictures, whatever the scene says; None to go by it.
        models: models_info.json, where it is not in models/ beside the split's folder.
        names: File with a name for each object id.

    Raises:
        FrameError: A file of the scene is missing or not valid, or depth is in an unknown unit.
    """

    def __init__(
        self, folder: Path, depth_scale: float | None = None, models: Path | None = None, names: Path | None = None
    ) -> None:
        self._folder = folder
        self._cameras = by_number(folder / CAMERA_FILE)
        if not self._cameras:
            raise FrameError(f"'{folder / CAMERA_FILE}' names no picture")
        truth = folder / TRUTH_FILE
        self._truths = by_number(truth) if truth.is_file() else {}
        info = folder / INFO_FILE
        self._infos = by_number(info) if info.is_file() else {}
        if models is not None and models.is_dir():
            models = models / "models_info.json"
        models = models or find_models(folder)
        self._models = read_models(models) if models is not None else {}
        names_file = names or find_names(models)
        self._names = read_names(names_file) if names_file is not None else {}
        said = any(isinstance(c, dict) and "depth_scale" in c for c in self._cameras.values())
        self._scale = depth_scale
        notes = []
        if depth_scale is not None or not said:
            first = first_depth(folder / "depth" / f"{k:06d}.png" for k in sorted(self._cameras))
            self._scale, note = checked_scale(depth_scale, first, f"the depth pictures of '{folder}'")
            notes += [note] if note else []
        with_world = sum(isinstance(c, dict) and "cam_R_w2c" in c for c in self._cameras.values())
        if with_world:
            notes.append(f"the world is that of {CAMERA_FILE}")
        if with_world < len(self._cameras):
            notes.append("the world's z = 0 is the plane that things stand on, found in each frame: no cam_R_w2c")
        if self._truths and not self._models:
            notes.append("no models_info.json: true sizes and the centres of boxes are not known")
        super().__init__(folder.name, len(self._cameras), tuple(notes), bool(self._truths))

    def _items(self, with_truth: bool) -> Iterator[TruthOfFrame | Skipped]:
        for number, camera in sorted(self._cameras.items()):
            try:
                frame = self._frame(number, camera)
                truth = self._truth(number, frame) if with_truth and number in self._truths else None
            except FrameError as error:
                yield Skipped(f"picture {number:06d}", str(error))
                continue
            yield TruthOfFrame(frame, truth)

    def _frame(self, number: int, camera: Any) -> RgbdFrame:
        where = f"picture {number} of '{self._folder / CAMERA_FILE}'"
        k = _numbers(camera, "cam_K", (3, 3), where)
        folder = next((self._folder / f for f in COLOUR_FOLDERS if (self._folder / f).is_dir()), self._folder / "rgb")
        stem = folder / f"{number:06d}"
        file = next((stem.with_suffix(e) for e in COLOUR_ENDINGS if stem.with_suffix(e).is_file()), None)
        if file is None:
            raise FrameError(f"the colour picture '{stem}.png' (or .jpg) is not there")
        colour = cv2.cvtColor(read_picture("colour", file, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
        depth_file = self._folder / "depth" / f"{number:06d}.png"
        raw = read_picture("depth", depth_file, cv2.IMREAD_UNCHANGED)
        if raw.shape[:2] != colour.shape[:2]:
            raise FrameError(
                f"the depth picture '{depth_file}' is {raw.shape[1]}x{raw.shape[0]}, its colour picture is "
                f"{colour.shape[1]}x{colour.shape[0]}: register depth to colour"
            )
        scale = self._scale
        if scale is None:
            scale = float(_numbers(camera, "depth_scale", (), where)) * MM
        metres = depth_in_metres(raw, scale, f"the depth picture '{depth_file}'")
        height, width = metres.shape
        lens = CameraIntrinsics(width, height, float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2]))
        if "cam_R_w2c" in camera:
            pose = np.linalg.inv(_rigid(camera, "cam_R_w2c", "cam_t_w2c", where))
        else:
            pose = camera_above_plane(metres, lens)
        return RgbdFrame(np.asarray(colour, np.uint8), metres, lens, pose, float(number), self._folder.name)

    def _truth(self, number: int, frame: RgbdFrame) -> FrameTruth:
        entries, infos = self._truths[number], self._infos.get(number, [])
        if not isinstance(entries, list):
            raise FrameError(f"picture {number} of '{self._folder / TRUTH_FILE}' is no list of objects")
        present = [int(_numbers(e, "obj_id", (), f"picture {number} of '{TRUTH_FILE}'")) for e in entries]
        objects = []
        for k, (entry, number_of_object) in enumerate(zip(entries, present, strict=True)):
            name = name_of(number_of_object, self._names)
            info = infos[k] if k < len(infos) and isinstance(infos[k], dict) else {}
            thing = self._object(number, k, entry, name, frame, float(info.get("visib_fract", 1.0)))
            if thing is not None:
                objects.append(thing)
        absent = tuple(name_of(i, self._names) for i in sorted(self._models) if i not in present)
        return FrameTruth(tuple(objects), absent)

    def _object(
        self, number: int, k: int, entry: Any, name: str, frame: RgbdFrame, visible_share: float
    ) -> TrueObject | None:
        """One object; None where it shows less than a few pixels."""
        where = f"object {k} of picture {number} of '{self._folder / TRUTH_FILE}'"
        pose = frame.world_T_camera @ _rigid(entry, "cam_R_m2c", "cam_t_m2c", where)
        model: BopModel | None = self._models.get(int(entry["obj_id"]))
        if model is not None:
            pose[:3, 3] += pose[:3, :3] @ model.centre
        file = self._folder / "mask_visib" / f"{number:06d}_{k:06d}.png"
        mask = None
        if file.is_file():
            mask = read_picture("mask", file, cv2.IMREAD_GRAYSCALE) > 0
            if mask.shape != frame.depth.shape:
                raise FrameError(f"the mask '{file}' is {mask.shape[1]}x{mask.shape[0]}, unlike its colour picture")
            if mask.sum() < LEAST_PIXELS:
                return None
        elif visible_share <= 0.0:
            return None
        extents = None if model is None else model.extents
        box = None if mask is None else box_around(mask)
        return TrueObject(name, pose, extents, _shape(model), mask, box, visible_share)


def scenes_below(folder: Path) -> list[Path]:
    """Scene folders in a data set's or split's folder, at most three levels down, the first hundred."""
    found: list[Path] = []
    for pattern in ("*", "*/*", "*/*/*"):
        found += sorted(f.parent for f in folder.glob(f"{pattern}/{CAMERA_FILE}"))[:100]
    return found


def by_number(file: Path) -> dict[int, Any]:
    """A BOP file's entries by number of picture.

    Raises:
        FrameError: It cannot be read, or a key is no number.
    """
    data = read_json(file)
    wrong = [key for key in data if not re.fullmatch(r"\d+", key)]
    if wrong:
        raise FrameError(f"'{file}' is not a BOP file: '{wrong[0]}' is no number of a picture")
    return {int(key): value for key, value in data.items()}


def _shape(model: BopModel | None) -> Any:
    """What the symmetries say: round about z and equally wide is a cylinder; nothing else can be told."""
    if model is None or model.round_about is None:
        return None
    return "cylinder" if abs(model.round_about[2]) > 0.99 else None


def _numbers(entry: Any, key: str, shape: tuple[int, ...], where: str) -> np.ndarray:
    try:
        values = np.array(entry[key], float).reshape(shape)
        if not np.isfinite(values).all():
            raise ValueError("not finite")
    except (KeyError, TypeError, ValueError) as error:
        raise FrameError(f"{where} has no valid {key}: {type(error).__name__} {error}") from error
    return values


def _rigid(entry: Any, rotation: str, translation: str, where: str) -> np.ndarray:
    """A transform from a row-wise rotation and a translation in [mm], shape (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = _numbers(entry, rotation, (3, 3), where)
    pose[:3, 3] = _numbers(entry, translation, (3,), where) * MM
    if not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-3):
        raise FrameError(f"{where}: {rotation} is no rotation")
    # Files keep few digits; frames want rotations to 1e-5.
    u, _, vt = np.linalg.svd(pose[:3, :3])
    pose[:3, :3] = u @ vt
    return pose
