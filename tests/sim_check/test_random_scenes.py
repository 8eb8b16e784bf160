"""Pictures of random cells: what they show is what their truth says."""

import numpy as np
import pytest

from perception.catalogue.catalogue import builtin_catalogue
from perception.geometry.cloud import back_project, to_world
from sim_check.random_scenes.labelled_pictures import vocabulary
from sim_check.random_scenes.scenes import RandomScenes, SceneOptions
from sim_check.random_scenes.things import drawn_nouns

SMALL = SceneOptions(width=240, height=180, scenes_per_pool=3, robot_share=0.0, furniture_share=0.5)


@pytest.fixture(scope="module")
def pictures():
    scenes = RandomScenes(5, SMALL)
    drawn = [scenes.picture() for _ in range(12)]
    scenes.close()
    return drawn


def test_the_same_seed_draws_the_same_pictures(pictures):
    scenes = RandomScenes(5, SMALL)
    for known in pictures[:8]:  # more than one pool
        again = scenes.picture()
        assert np.array_equal(again.labels, known.labels)
        assert np.array_equal(again.world_T_camera, known.world_T_camera)
    scenes.close()


def test_boxes_enclose_exactly_the_labelled_pixels(pictures):
    for picture in pictures:
        for seen in picture.seen:
            rows, columns = np.nonzero(picture.labels == seen.label)
            assert seen.pixels == len(rows)
            assert tuple(seen.box_px) == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)


def test_labelled_pixels_lie_inside_the_things_own_box(pictures):
    checked = 0
    for picture in pictures:
        for seen in picture.seen:
            if seen.joint_fractions:
                continue  # open doors reach out of the body's box
            points = back_project(picture.depth, picture.intrinsics)[picture.labels == seen.label]
            world = to_world(points, picture.world_T_camera)
            local = (world - seen.world_T_object[:3, 3]) @ seen.world_T_object[:3, :3]
            beyond = (np.abs(local) - seen.thing.extents / 2).max()
            assert beyond < 0.003, (seen.thing.nouns, beyond)
            checked += 1
    assert checked > 20


def test_visible_shares_are_shares_and_whole_things_are_nearly_whole(pictures):
    shares = [s.visible_share for p in pictures for s in p.seen]
    assert min(shares) >= 0.0 and max(shares) <= 1.0
    assert np.mean(np.array(shares) > 0.9) > 0.4


def test_nothing_that_is_there_is_called_absent_and_names_are_unique():
    scenes = RandomScenes(11, SMALL)
    for _ in range(8):
        _, truth = scenes.frame()
        names = [o.name for o in truth.objects]
        assert len(set(names)) == len(names)
        assert not set(names) & set(truth.absent)
        for name in names:
            noun = name.split("_")[-1]
            assert noun in drawn_nouns(builtin_catalogue())
            assert noun not in truth.absent
    scenes.close()


def test_a_frame_has_stereo_noise_and_its_picture_has_not():
    exact, noisy = RandomScenes(3, SMALL), RandomScenes(3, SMALL)
    picture, (frame, _) = exact.picture(0.7), noisy.frame(0.7)
    assert np.array_equal(picture.colour, frame.colour)
    both = np.isfinite(picture.depth) & np.isfinite(frame.depth)
    assert 0.0005 < np.abs(picture.depth - frame.depth)[both].mean() < 0.05
    assert np.isnan(frame.depth).sum() > np.isnan(picture.depth).sum()
    exact.close()
    noisy.close()


def test_the_vocabulary_names_every_kind():
    words = vocabulary(builtin_catalogue())
    assert set(words["nouns"]) == {n for names in words["kinds"] for n in names}
    assert set(words["colours"]) == set(builtin_catalogue().painted_words)
    assert all(set(a) <= set(b) for a, b in zip(words["kinds"], words["may_be_called"], strict=True))
