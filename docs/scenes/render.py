"""Renders the pictures of docs/scenes.md: left a spectator's view, right what the cell's first camera sees.

Run from the checkout: MUJOCO_GL=egl .venv/bin/python docs/scenes/render.py [CELL ...]
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from sim_check.cells.loading import builtin_cells, load_cell
from sim_check.models.render import FreeView
from sim_check.world.world import build_world

SEED = 0
VIEW = FreeView(look_at=(0.42, 0.0, 0.22), distance=1.9, azimuth_deg=38.0, elevation_deg=-33.0)
SIZE = (400, 300)  # of each half in [px]
COLOURS = 160


def main(names: list[str]) -> None:
    """Write one PNG per cell beside this file."""
    for name in names:
        world = build_world(load_cell(name), SEED)
        halves = [world.spectator(VIEW), world.render(world.cameras[0].name)[0]]
        world.close()
        small = [np.asarray(Image.fromarray(h).resize(SIZE, Image.Resampling.LANCZOS)) for h in halves]
        # Median cut would lose the colours of small things.
        picture = Image.fromarray(np.hstack(small)).quantize(
            COLOURS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
        )
        picture.save(Path(__file__).with_name(f"{name}.png"), optimize=True)


if __name__ == "__main__":
    main(sys.argv[1:] or list(builtin_cells()))
