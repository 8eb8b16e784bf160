"""Scene folders of BOP data sets: frames, truth for scorers, and all that may be missing or wrong."""

import json
import re

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from perception.errors import FrameError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.ground_truth import FrameTruth, TrueObject, box_around
from perception.recordings.base import TruthOfFrame
from perception.recordings.bop_writing import write_bop_scene
from perception.recordings.opening import open_recording

LENS = CameraIntrinsics(32, 24, 30.0, 31.0, 15.5, 11.5)
IDS = {"red_cube": 1, "mustard_bottle": 5}


def rigid(angles, position):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_euler("xyz", angles, degrees=True).as_matrix(), position
    return pose


def scene_frames():
    """Three frames with a cube and, but for the last, a bottle that is half hidden."""
    rng, frames = np.random.default_rng(5), []
    for k in range(3):
        depth = rng.uniform(0.4, 1.2, (24, 32)).astype(np.float32)
        depth[0, 0] = np.nan
        cube, bottle = np.zeros((24, 32), bool), np.zeros((24, 32), bool)
        cube[3:9, 4:10], bottle[12:20, 15:20] = True, True
        picture = rng.integers(0, 255, (24, 32, 3), dtype=np.uint8)
        frame = RgbdFrame(picture, depth, LENS, rigid([170, 5 * k, 20], [0.1, 0.2, 0.8]), float(k), "000001")
        things = [
            TrueObject("red_cube", rigid([0, 0, 30], [0.4, 0.1, 0.02]), np.full(3, 0.05), None, cube, box_around(cube)),
            TrueObject(
                "mustard_bottle", rigid([90, 0, 0], [0.5, 0, 0.1]), np.array([0.1, 0.06, 0.19]), None, bottle, None, 0.5
            ),
        ]
        frames.append(TruthOfFrame(frame, FrameTruth(tuple(things[: 2 if k < 2 else 1]))))
    return frames


@pytest.fixture
def scene(tmp_path):
    folder = tmp_path / "dataset" / "test" / "000001"
    write_bop_scene(folder, scene_frames(), IDS)
    return folder


def truth_of(item: TruthOfFrame) -> FrameTruth:
    """The truth, which is there."""
    assert item.truth is not None
    return item.truth


def first_truth(recording) -> FrameTruth:
    """Of the first frame."""
    return truth_of(next(iter(recording.with_truth())))


def edit(file, change):
    """Change a JSON file in place."""
    data = json.loads(file.read_text())
    change(data)
    file.write_text(json.dumps(data))


def test_a_scene_becomes_frames_in_the_scenes_world(scene):
    recording = open_recording(scene)
    assert recording.count == 3 and recording.name == "000001"
    assert recording.notes == ("the world is that of scene_camera.json",)
    for before, after in zip(scene_frames(), recording, strict=True):
        assert np.array_equal(before.frame.colour, after.colour)
        assert np.allclose(before.frame.depth, after.depth, equal_nan=True, atol=6e-5), "half of 0.1 mm"
        assert np.allclose(before.frame.world_T_camera, after.world_T_camera, atol=1e-9)
        assert after.intrinsics == LENS


def test_the_truth_has_poses_masks_sizes_and_shares_in_the_scenes_world(scene):
    recording = open_recording(scene)
    assert recording.has_truth
    read = list(recording.with_truth())
    for before, after in zip(scene_frames(), read, strict=True):
        for o, found in zip(truth_of(before).objects, truth_of(after).objects, strict=True):
            assert found.name == o.name and found.visible_share == o.visible_share
            assert np.allclose(found.world_T_object, o.world_T_object, atol=1e-9)
            assert found.extents is not None and o.extents is not None and found.mask is not None and o.mask is not None
            assert np.allclose(found.extents, o.extents) and np.array_equal(found.mask, o.mask)
    last = truth_of(read[-1])
    assert last.absent == ("mustard_bottle",)
    assert last.objects[0].box_px is not None and last.objects[0].box_px.tolist() == [4, 3, 10, 9]


def test_the_centre_of_a_models_box_is_the_origin_and_a_round_model_is_a_cylinder(scene):
    def change(models):
        models["1"].update(min_x=-25.0, min_y=-25.0, min_z=0.0)
        models["1"]["symmetries_continuous"] = [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]

    edit(scene.parent.parent / "models" / "models_info.json", change)
    cube = first_truth(open_recording(scene)).objects[0]
    before = truth_of(scene_frames()[0]).objects[0].world_T_object
    assert np.allclose(cube.world_T_object[:3, 3], before[:3, 3] + 0.025 * before[:3, 2])
    assert cube.shape == "cylinder"


def test_objects_without_names_are_called_by_their_numbers_and_a_file_names_them(scene, tmp_path):
    (scene.parent.parent / "models" / "names.json").unlink()
    names = tmp_path / "called.yaml"

    def called(**options):
        return [o.name for o in first_truth(open_recording(scene, **options)).objects]

    assert called() == ["obj_000001", "obj_000005"]
    names.write_text("{1: Red Cube, 5: mustard}")
    assert called(object_names=names) == ["red_cube", "mustard"]
    names.write_text("{one: red cube}")
    with pytest.raises(FrameError, match=r"the file of object names .* is not valid: .* for instance \{1: red"):
        open_recording(scene, object_names=names)
    names.write_text("{1: cube, 5: cube}")
    with pytest.raises(FrameError, match="no name for an id, or 'cube' for several"):
        open_recording(scene, object_names=names)


def test_a_scene_without_models_says_that_sizes_are_unknown(scene):
    (scene.parent.parent / "models" / "models_info.json").unlink()
    recording = open_recording(scene)
    assert recording.notes[-1] == "no models_info.json: true sizes and the centres of boxes are not known"
    assert first_truth(recording).objects[0].extents is None


def test_models_elsewhere_can_be_named_and_must_have_sizes(scene, tmp_path):
    models = tmp_path / "elsewhere"
    (scene.parent.parent / "models").rename(models)
    extents = first_truth(open_recording(scene, models=models)).objects[0].extents
    assert extents is not None and np.allclose(extents, 0.05)
    edit(models / "models_info.json", lambda data: data["5"].pop("size_y"))
    with pytest.raises(FrameError, match=r"object '5' of .* is not valid: KeyError 'size_y'; it needs min_x"):
        open_recording(scene, models=models / "models_info.json")


def test_a_scene_without_truth_is_read_as_well(scene):
    for name in ("scene_gt.json", "scene_gt_info.json"):
        (scene / name).unlink()
    recording = open_recording(scene)
    assert not recording.has_truth and [t.truth for t in recording.with_truth()] == [None] * 3


def test_jpeg_and_grey_pictures_are_colour_too(scene):
    for file in (scene / "rgb").iterdir():
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        assert grey is not None
        cv2.imwrite(str(file.with_suffix(".jpg")), grey)
        file.unlink()
    (scene / "rgb").rename(scene / "gray")
    assert len(list(open_recording(scene))) == 3


def test_a_scene_without_the_cameras_pose_stands_on_its_plane(scene):
    def change(cameras):
        for camera in cameras.values():
            del camera["cam_R_w2c"], camera["cam_t_w2c"]

    edit(scene / "scene_camera.json", change)
    v, _ = np.mgrid[0:24, 0:32]
    plane = 0.5 / (np.sin(np.pi / 4) + (v - 11.5) / 31.0 * np.cos(np.pi / 4))
    for k in range(3):
        cv2.imwrite(str(scene / "depth" / f"00000{k}.png"), np.rint(plane * 10000).astype(np.uint16))
    recording = open_recording(scene)
    assert recording.notes[0].endswith("found in each frame: no cam_R_w2c")
    first = next(iter(recording.with_truth()))
    assert first.frame.world_T_camera[2, 3] == pytest.approx(0.5, abs=2e-3)
    before = scene_frames()[0]
    camera_T_cube = np.linalg.inv(before.frame.world_T_camera) @ truth_of(before).objects[0].world_T_object
    found = truth_of(first).objects[0].world_T_object
    assert np.allclose(found, first.frame.world_T_camera @ camera_T_cube, atol=1e-9)


def test_a_data_sets_folder_names_the_scenes_that_it_holds(scene):
    write_bop_scene(scene.parent / "000002", scene_frames(), IDS)
    for folder in (scene.parent, scene.parent.parent, scene.parent.parent.parent):
        with pytest.raises(FrameError, match=r"is not one recording: it holds 2 BOP scenes, '.*000001', '.*000002'"):
            open_recording(folder)


def test_pictures_that_are_missing_broken_or_of_another_size_are_left_out_and_named(scene):
    (scene / "rgb" / "000000.png").unlink()
    cv2.imwrite(str(scene / "depth" / "000001.png"), np.ones((12, 16), np.uint16))
    recording = open_recording(scene)
    assert [f.stamp for f in recording] == [2.0]
    assert [s.where for s in recording.skipped] == ["picture 000000", "picture 000001"]
    assert "000000.png' (or .jpg) is not there" in recording.skipped[0].reason
    assert "is 16x12, its colour picture is 32x24: register depth to colour" in recording.skipped[1].reason


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("cam_K", [1, 2], "picture 1 of .* has no valid cam_K: ValueError"),
        ("cam_K", None, "picture 1 of .* has no valid cam_K"),
        ("cam_R_w2c", [2, 0, 0, 0, 1, 0, 0, 0, 1], "picture 1 of .*: cam_R_w2c is no rotation"),
        ("cam_t_w2c", ["a", 0, 0], "picture 1 of .* has no valid cam_t_w2c"),
        ("depth_scale", "x", "depth_scale"),
    ],
)
def test_a_wrong_number_of_a_camera_is_named(scene, key, value, text):
    edit(scene / "scene_camera.json", lambda data: data["1"].update({key: value}))
    recording = open_recording(scene)
    assert [f.stamp for f in recording] == [0.0, 2.0]
    (skipped,) = recording.skipped
    assert re.search(text, skipped.reason)


def test_a_wrong_truth_is_named_and_only_scorers_meet_it(scene):
    edit(scene / "scene_gt.json", lambda data: data["1"][0].pop("cam_t_m2c"))
    recording = open_recording(scene)
    assert len(list(recording)) == 3
    assert len(list(recording.with_truth())) == 2
    assert "object 0 of picture 1 of" in recording.skipped[0].reason


def test_depth_in_an_unknown_unit_is_asked_for(scene):
    def change(cameras):
        for camera in cameras.values():
            del camera["depth_scale"]

    edit(scene / "scene_camera.json", change)
    with pytest.raises(FrameError, match=r"nothing says the unit of the depth pictures of .* say --depth-scale"):
        open_recording(scene)
    assert len(list(open_recording(scene, depth_scale=0.0001))) == 3


def test_files_that_are_no_scene_are_refused(scene):
    (scene / "scene_camera.json").write_text("[]")
    with pytest.raises(FrameError, match=r"scene_camera.json' is not a BOP file: it holds a list"):
        open_recording(scene)
    (scene / "scene_camera.json").write_text('{"first": {}}')
    with pytest.raises(FrameError, match="'first' is no number of a picture"):
        open_recording(scene)
    (scene / "scene_camera.json").write_text("{")
    with pytest.raises(FrameError, match=r"scene_camera.json' cannot be read"):
        open_recording(scene)
    (scene / "scene_camera.json").write_text("{}")
    with pytest.raises(FrameError, match=r"scene_camera.json' names no picture"):
        open_recording(scene)
