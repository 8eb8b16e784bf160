"""Shards of labelled pictures of random cells, which detectors and segmenters are trained on.

    python -m sim_check.random_scenes.labelled_pictures --out FOLDER --first 0 --shards 20 --pictures 200

A shard is one .npz file:

    meta       JSON text: nouns, colours; what each kind of thing is called, and what it may be called
    pictures   JPEG bytes of all pictures, one behind the other; picture_ends: where each ends
    labels     PNG bytes of the label pictures, likewise; label_ends
    things     int32, shape (n, 10): picture, label, kind, colour, x0, y0, x1, y1 [px], visible share in thousandths,
               clear 0/1

Shard number k is drawn from seed k, so shards can be made in any order, by several processes, and again.
"""

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from perception.catalogue.catalogue import Catalogue
from sim_check.random_scenes.scenes import LabelledPicture, RandomScenes, SceneOptions
from sim_check.random_scenes.things import drawn_nouns, drawn_objects, kind_names

FORMAT = "labelled-pictures-1"
HELD_OUT = 1_000_000  # seeds from here on are never trained on
WIDTH, HEIGHT = 480, 360


def vocabulary(catalogue: Catalogue) -> dict:
    """What the numbers in `things` mean."""
    names, drawn = kind_names(catalogue), drawn_objects(catalogue)
    others = [drawn[n[0]].may_be_called if n[0] in drawn else () for n in names]
    return {
        "format": FORMAT,
        "nouns": list(drawn_nouns(catalogue)),
        "colours": list(catalogue.painted_words),
        "kinds": [list(n) for n in names],
        "may_be_called": [sorted({*n, *more}) for n, more in zip(names, others, strict=True)],
        "alike_colours": [sorted(pair) for pair in catalogue.alike_colours],
    }


def write_shard(path: Path, seed: int, count: int, mesh_cache: Path | None = None) -> None:
    """Render one shard; the file appears when it is complete.

    Args:
        path: File to write.
        seed: Of everything in it.
        count: Number of pictures.
        mesh_cache: Folder in which the robot's converted meshes are kept.

    Raises:
        MachineError: No way to render on this machine.
    """
    options = SceneOptions(width=WIDTH, height=HEIGHT, repeats=True, depth_noise=None)
    scenes = RandomScenes(seed, options, mesh_cache)
    pictures, labels, rows = [], [], []
    for k in range(count):
        picture = scenes.picture()
        pictures.append(cv2.imencode(".jpg", picture.colour[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])[1])
        labels.append(cv2.imencode(".png", picture.labels)[1])
        rows += _rows(k, picture, scenes.catalogue)
    scenes.close()
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
        np.savez(
            file,
            meta=np.array(json.dumps(vocabulary(scenes.catalogue))),
            pictures=np.concatenate(pictures),
            picture_ends=np.cumsum([len(p) for p in pictures]),
            labels=np.concatenate(labels),
            label_ends=np.cumsum([len(p) for p in labels]),
            things=np.array(rows, np.int32).reshape(-1, 10),
        )
    os.replace(file.name, path)


def _rows(number: int, picture: LabelledPicture, catalogue: Catalogue) -> list[tuple[int, ...]]:
    kinds, colours = kind_names(catalogue), tuple(catalogue.painted_words)
    return [
        (
            number,
            s.label,
            kinds.index(s.thing.nouns),
            colours.index(s.thing.colour),
            *(int(v) for v in s.box_px),
            round(1000 * s.visible_share),
            int(s.clear),
        )
        for s in picture.seen
    ]


def shard_path(folder: Path, seed: int) -> Path:
    """Where the shard of a seed lies."""
    return folder / f"shard_{seed:07d}.npz"


def main() -> None:
    """Render the shards that are not there yet."""
    parser = argparse.ArgumentParser(description="Render shards of labelled pictures for training")
    parser.add_argument("--out", type=Path, required=True, help="folder for the shards")
    parser.add_argument("--first", type=int, default=0, help="seed of the first shard")
    parser.add_argument("--shards", type=int, default=10, help="how many")
    parser.add_argument("--pictures", type=int, default=200, help="pictures in each")
    args = parser.parse_args()
    for seed in range(args.first, args.first + args.shards):
        path = shard_path(args.out, seed)
        if not path.exists():
            write_shard(path, seed, args.pictures, args.out / "meshes")
            print(f"{path} written", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
