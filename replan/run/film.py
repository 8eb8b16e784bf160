"""Pictures of a run: frames of the cell's camera while it moves, as a video and as one strip to look at."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

FILM_RATE = 3.0  # pictures a second of robot time; software rendering of more would slow a simulated cell down
TILE_WIDTH = 480  # [px]
CAPTION_HEIGHT = 26  # [px]


@dataclass
class Film:
    """Collects captioned pictures.

    Attributes:
        frames: (caption, RGB uint8 (h, w, 3)) of the cell's camera while it moves, in order.
        stills: (caption, RGB uint8 (h, w, 3)) worth a place in the strip: what was seen, the twin.
    """

    frames: list[tuple[str, np.ndarray]] = field(default_factory=list)
    stills: list[tuple[str, np.ndarray]] = field(default_factory=list)

    def write_video(self, path: Path) -> bool:
        """Write the frames as MP4 (MPEG-4 part 2); returns whether there was anything to write."""
        import cv2

        if not self.frames:
            return False
        tiles = [_tile(caption, image) for caption, image in self.frames]
        height, width = tiles[0].shape[:2]
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), FILM_RATE, (width, height))
        try:
            for tile in tiles:
                writer.write(np.ascontiguousarray(tile[:, :, ::-1]))
        finally:
            writer.release()
        return True

    def write_strip(self, path: Path, columns: int = 4, moving: int = 5) -> bool:
        """Write stills and evenly chosen frames as one PNG; returns whether there was anything to write.

        Args:
            path: Where to.
            columns: Pictures a row.
            moving: How many of the camera's frames to show.
        """
        import cv2

        chosen = [self.frames[k] for k in _evenly(len(self.frames), moving)]
        # Seen first, twin, motion, seen last: the order of the run itself.
        before, after = (self.stills[:-1], self.stills[-1:]) if len(self.stills) > 1 else (self.stills, [])
        tiles = [_tile(caption, image) for caption, image in [*before, *chosen, *after]]
        if not tiles:
            return False
        height = max(t.shape[0] for t in tiles)
        tiles = [_pad(t, height) for t in tiles]
        while len(tiles) % columns:
            tiles.append(np.full_like(tiles[0], 255))
        rows = [np.hstack(tiles[k : k + columns]) for k in range(0, len(tiles), columns)]
        cv2.imwrite(str(path), np.vstack(rows)[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
        return True


def _evenly(count: int, wanted: int) -> list[int]:
    """Indices of at most `wanted` out of `count`, evenly spread, ends included."""
    if count <= wanted:
        return list(range(count))
    return [round(x) for x in np.linspace(0, count - 1, wanted)]


def _tile(caption: str, image: np.ndarray) -> np.ndarray:
    """The picture at the tile's width with its caption above, RGB."""
    import cv2

    height = round(image.shape[0] * TILE_WIDTH / image.shape[1] / 2) * 2
    body = cv2.resize(image, (TILE_WIDTH, height), interpolation=cv2.INTER_AREA)
    head = np.full((CAPTION_HEIGHT, TILE_WIDTH, 3), 245, np.uint8)
    cv2.putText(head, caption[:64], (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (30, 30, 30), 1, cv2.LINE_AA)
    return np.vstack([head, body])


def _pad(tile: np.ndarray, height: int) -> np.ndarray:
    return np.pad(tile, ((0, height - tile.shape[0]), (0, 0), (0, 0)), constant_values=255)
