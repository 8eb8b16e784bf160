"""A run's pictures can be looked at: a strip in the order of the run, and a video."""

import cv2
import numpy as np

from replan.run.film import CAPTION_HEIGHT, TILE_WIDTH, Film


def picture(level, height=480, width=640):
    return np.full((height, width, 3), level, np.uint8)


def test_the_strip_shows_stills_around_the_motion_in_the_order_of_the_run(tmp_path):
    film = Film(
        frames=[(f"{k} s", picture(100 + k)) for k in range(40)],
        stills=[("seen", picture(10)), ("twin", picture(20)), ("seen again", picture(30))],
    )
    assert film.write_strip(tmp_path / "strip.png", columns=4, moving=5)
    strip = cv2.imread(str(tmp_path / "strip.png"))
    assert strip is not None
    tile_height = CAPTION_HEIGHT + 360
    assert strip.shape == (2 * tile_height, 4 * TILE_WIDTH, 3)
    levels = [int(strip[r * tile_height + 200, c * TILE_WIDTH + 200, 0]) for r in range(2) for c in range(4)]
    assert levels == [10, 20, 100, 110, 120, 129, 139, 30]


def test_the_video_holds_every_frame_taken(tmp_path):
    film = Film(frames=[(f"{k} s", picture(10 * k)) for k in range(12)])
    assert film.write_video(tmp_path / "run.mp4")
    video = cv2.VideoCapture(str(tmp_path / "run.mp4"))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == 12


def test_a_run_that_saw_nothing_leaves_no_pictures(tmp_path):
    assert not Film().write_strip(tmp_path / "strip.png")
    assert not Film().write_video(tmp_path / "run.mp4")
    assert list(tmp_path.iterdir()) == []
