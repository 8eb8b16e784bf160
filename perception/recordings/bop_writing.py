"""Frames and their truth into the folders of a BOP data set, for benchmarks and for other programs that read it."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from perception.recordings.base import TruthOfFrame

MM = 1000.0  # [mm] a metre
DEPTH_SCALE = 0.1  # [mm] a unit of the depth pictures


def write_bop_scene(scene: Path, frames: Iterable[TruthOfFrame], ids: Mapping[str, int]) -> None:
    """Write a scene folder, and models/models_info.json and names.json two levels above it.

    Models are the boxes of the objects: their origin is the box's centre. Depth is rounded to 0.1 mm, up to 6.5 m.

    Args:
        scene: Folder of the scene, for instance dataset/test/000001; made when absent.
        frames: Frames with their truth.
        ids: Number of each object's name.

    Raises:
        OSError: The folder cannot be written.
    """
    for kind in ("rgb", "depth", "mask_visib"):
        (scene / kind).mkdir(parents=True, exist_ok=True)
    cameras: dict[str, Any] = {}
    truths: dict[str, Any] = {}
    infos: dict[str, Any] = {}
    models: dict[str, Any] = {}
    for number, item in enumerate(frames):
        frame, name = item.frame, f"{number:06d}"
        camera_T_world = np.linalg.inv(frame.world_T_camera)
        units = np.rint(np.nan_to_num(frame.depth, nan=0.0, posinf=0.0, neginf=0.0) * MM / DEPTH_SCALE)
        depth = np.where((units >= 1) & (units <= 65535), units, 0).astype(np.uint16)
        cv2.imwrite(str(scene / "rgb" / f"{name}.png"), np.ascontiguousarray(frame.colour[:, :, ::-1]))
        cv2.imwrite(str(scene / "depth" / f"{name}.png"), depth)
        cameras[str(number)] = {
            "cam_K": frame.intrinsics.matrix.ravel().tolist(),
            "depth_scale": DEPTH_SCALE,
            "cam_R_w2c": camera_T_world[:3, :3].ravel().tolist(),
            "cam_t_w2c": (camera_T_world[:3, 3] * MM).tolist(),
        }
        truths[str(number)], infos[str(number)] = [], []
        for k, o in enumerate(item.truth.objects if item.truth is not None else ()):
            pose = camera_T_world @ o.world_T_object
            truths[str(number)].append(
                {
                    "obj_id": ids[o.name],
                    "cam_R_m2c": pose[:3, :3].ravel().tolist(),
                    "cam_t_m2c": (pose[:3, 3] * MM).tolist(),
                }
            )
            infos[str(number)].append({"visib_fract": o.visible_share})
            if o.mask is not None:
                cv2.imwrite(str(scene / "mask_visib" / f"{name}_{k:06d}.png"), o.mask.astype(np.uint8) * 255)
            if o.extents is not None:
                size = o.extents * MM
                low = {f"min_{a}": -float(s) / 2 for a, s in zip("xyz", size, strict=True)}
                sizes = {f"size_{a}": float(s) for a, s in zip("xyz", size, strict=True)}
                models[str(ids[o.name])] = {"diameter": float(np.linalg.norm(size)), **low, **sizes}
    for file, data in (("scene_camera", cameras), ("scene_gt", truths), ("scene_gt_info", infos)):
        (scene / f"{file}.json").write_text(json.dumps(data), encoding="utf-8")
    folder = scene.parent.parent / "models"
    folder.mkdir(exist_ok=True)
    (folder / "models_info.json").write_text(json.dumps(models), encoding="utf-8")
    (folder / "names.json").write_text(json.dumps({str(i): n for n, i in ids.items()}), encoding="utf-8")
