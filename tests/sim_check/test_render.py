"""What the simulated cameras deliver: registered colour and metric depth, with noise as its formula says."""

import mujoco
import numpy as np
import pytest

from benchmarks.scenes.estimates import exact_scene
from control.errors import ConfigError
from control.robot.limits import REST_Q
from perception.frames import RgbdFrame
from sim_check.cells.loading import DepthNoiseConfig, load_cell
from sim_check.models.render import FreeView, available_backend, render_twin
from sim_check.twin.twin import build_twin
from sim_check.world.depth_noise import stereo_depth
from sim_check.world.world import build_world

FX = 600.0


def no_noise(cell):
    return cell.model_copy(update={"simulation": cell.simulation.model_copy(update={"depth_noise": None})})


def back_project(depth, pose, lens):
    """World points of all pixels in [m], shape (height, width, 3)."""
    v, u = np.indices(depth.shape)
    rays = np.stack([(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, np.ones(depth.shape)], axis=-1)
    return (rays * depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]


@pytest.fixture(scope="module")
def clean_world():
    world = build_world(no_noise(load_cell("cubes-blocked")), seed=0, meshes=False)
    yield world
    world.close()


def test_a_way_to_render_is_found_and_named():
    assert available_backend() in ("egl", "glfw", "osmesa")


def test_a_missing_graphics_library_is_answered_with_the_packages_to_install(monkeypatch):
    def broken(*_):
        raise ImportError("no libEGL")

    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr("mujoco.egl.GLContext", broken)
    with pytest.raises(ConfigError, match=r"no libEGL.*libegl1 libgl1-mesa-dri"):
        available_backend()


def test_pictures_make_a_valid_frame(clean_world):
    for camera in clean_world.cameras:
        colour, depth, pose, lens = clean_world.render(camera.name)
        RgbdFrame(colour, depth, lens, pose, stamp=0.0, camera=camera.name)
        assert depth.dtype == np.float32
        assert colour.std() > 5


@pytest.mark.parametrize("camera", ["static", "wrist"])
def test_depth_back_projects_onto_the_true_table_and_objects(clean_world, camera):
    _, depth, pose, lens = clean_world.render(camera)
    points = back_project(depth, pose, lens)
    # Table top in the work area: at z = 0, but for the lowest rows of pixels on the objects' sides.
    area = (np.abs(points[..., 1]) < 0.3) & (points[..., 0] > 0.4) & (points[..., 0] < 0.6)
    table = points[area & (np.abs(points[..., 2]) < 0.004)]
    assert len(table) > 5000
    assert np.quantile(np.abs(table[:, 2]), 0.98) < 2e-5
    # Top face of the cube on the crate: its middle is where the cube truly is.
    cube = clean_world.object_pose("yellow_cube")
    near = np.linalg.norm(points[..., :2] - cube[:2, 3], axis=-1) < 0.05
    top = points[near & (np.abs(points[..., 2] - cube[2, 3] - 0.025) < 0.001)]
    assert len(top) > 100
    middle = (top.min(axis=0) + top.max(axis=0)) / 2
    assert np.linalg.norm(middle[:2] - cube[:2, 3]) < 0.003


def test_colour_and_depth_show_the_same_pixels(clean_world):
    colour, depth, pose, lens = clean_world.render("static")
    points = back_project(depth, pose, lens)
    cube = clean_world.object_pose("red_cube")
    on_cube = np.linalg.norm(points - cube[:3, 3], axis=-1) < 0.024 * 1.4
    inside = on_cube & (points[..., 2] > 0.006)
    red = (colour[..., 0] > 90) & (colour[..., 1] < 60)
    assert inside.sum() > 200
    assert red[inside].mean() > 0.95


@pytest.mark.parametrize("lens", [{"cx": 300.0, "cy": 260.0}, {"fy": 500.0}])
def test_a_lens_that_is_not_centred_or_square_is_rendered_as_its_numbers_say(lens):
    cell = no_noise(load_cell("cubes"))
    static = cell.camera("static").model_copy(update=lens)
    world = build_world(cell.model_copy(update={"cameras": (static,)}), seed=0, meshes=False)
    _, depth, pose, intrinsics = world.render("static")
    world.close()
    crate = world.object_pose("crate")
    # The middle of the crate's top must be found where the pinhole model says.
    corner = np.linalg.inv(pose) @ crate @ np.array([0.0, 0.0, 0.0299, 1.0])
    u = round(intrinsics.fx * corner[0] / corner[2] + intrinsics.cx)
    v = round(intrinsics.fy * corner[1] / corner[2] + intrinsics.cy)
    assert depth[v, u] == pytest.approx(corner[2], abs=0.006)
    points = back_project(depth, pose, intrinsics)
    half = 0.055 * np.sqrt(2)
    near = np.linalg.norm(points[..., :2] - crate[:2, 3], axis=-1) < half + 0.02
    top = points[near & (np.abs(points[..., 2] - 0.06) < 0.002)]
    middle = (top.min(axis=0) + top.max(axis=0)) / 2
    assert np.linalg.norm(middle[:2] - crate[:2, 3]) < 0.003


@pytest.mark.parametrize(("name", "options"), [("cubes", None), ("fruit-bowl", {"lemon_in_bowl": True})])
def test_the_static_camera_sees_every_object_over_some_seeds(name, options):
    cell = no_noise(load_cell(name, options))
    for seed in range(4):
        world = build_world(cell, seed, meshes=False)
        _, depth, pose, lens = world.render("static")
        world.close()
        points = back_project(depth, pose, lens)
        for thing in world.object_names:
            truth = world.object_pose(thing)
            local = (points - truth[:3, 3]) @ truth[:3, :3]
            on_it = np.all(np.abs(local) < world.objects[thing].extents / 2 + 0.002, axis=-1)
            on_it &= points[..., 2] > 0.005  # its foot cannot be told from the table
            # 50 mm at 1.1 m are 26 px: a whole cube shows more than 600 pixels, one behind another at least half.
            assert on_it.sum() > 300, (seed, thing)
            assert not np.any(on_it[:, [0, -1]]), (seed, thing)
            assert not np.any(on_it[[0, -1]]), (seed, thing)


def test_the_arm_at_rest_does_not_hide_the_work_area():
    cell = no_noise(load_cell("cubes"))
    world = build_world(cell, seed=0)
    _, depth, pose, lens = world.render("static")
    world.close()
    points = back_project(depth, pose, lens)
    # Anything seen high above the objects would be the arm in front of them.
    v, _ = np.nonzero(points[..., 2] > 0.14)
    table = np.array([[x, y, 0.0, 1.0] for x in (0.33, 0.66) for y in (-0.33, 0.33)])
    seen = table @ np.linalg.inv(pose).T
    rows = lens.fy * seen[:, 1] / seen[:, 2] + lens.cy
    assert v.max(initial=-1) < rows.min()


def test_an_unknown_camera_is_answered_with_those_there_are(clean_world):
    with pytest.raises(ConfigError, match=r"no camera 'side'; there are \['static', 'wrist'\]"):
        clean_world.render("side")


def test_a_copy_of_the_state_can_be_shown(clean_world):
    data = mujoco.MjData(clean_world.model)
    data.qpos[:] = clean_world.data.qpos
    data.joint("red_cube").qpos[2] += 0.3
    mujoco.mj_forward(clean_world.model, data)
    here, there = clean_world.render("static")[0], clean_world.render("static", data)[0]
    assert np.mean(np.any(here != there, axis=-1)) > 0.002


def test_a_twin_is_shown_with_its_objects(clean_world):
    twin = build_twin(load_cell("cubes-blocked"), exact_scene(clean_world), np.array(REST_Q), 0.08)
    picture = render_twin(twin, 320, 240)
    assert picture.shape == (240, 320, 3)
    assert picture.dtype == np.uint8
    close = render_twin(twin, 160, 120, FreeView(look_at=(0.48, 0.0, 0.03), distance=0.8, elevation_deg=-60.0))
    red = (close[..., 0] > 90) & (close[..., 1] < 60) & (close[..., 2] < 60)
    assert red.sum() > 30


def flat(distance, shape=(240, 320)):
    return np.full(shape, distance, np.float32)


@pytest.mark.parametrize("distance", [0.5, 0.9])
def test_depth_noise_on_a_wall_grows_with_the_square_of_distance(distance):
    noise = DepthNoiseConfig(blob_share=0.0)
    measured = stereo_depth(flat(distance), FX, noise, np.random.default_rng(0))
    expected = distance**2 / (FX * noise.baseline) * noise.disparity_std_px
    assert np.isfinite(measured).all()
    # 240 x 320 pixels correlated over 3 px are some 700 independent ones: 3 % of uncertainty, and rounding adds 1 %.
    assert np.std(measured) == pytest.approx(expected, rel=0.1)
    # Depth is convex in disparity, so its mean lies a little beyond the truth.
    assert abs(np.mean(measured) - distance) < 0.2 * expected


def test_neighbouring_pixels_err_together_and_far_ones_do_not():
    noise = DepthNoiseConfig(blob_share=0.0)
    error = stereo_depth(flat(0.8), FX, noise, np.random.default_rng(1)) - 0.8
    error -= error.mean()

    def correlation(step):
        return np.mean(error[:, :-step] * error[:, step:]) / np.mean(error**2)

    # White noise smoothed by a Gaussian of sigma s correlates as exp(-step^2 / (4 s^2)).
    for step in (2, 4):
        expected = np.exp(-(step**2) / (4 * noise.correlation_px**2))
        assert correlation(step) == pytest.approx(expected, abs=0.1)
    assert abs(correlation(20)) < 0.15


def test_disparities_come_in_sub_pixel_steps():
    noise = DepthNoiseConfig(blob_share=0.0)
    measured = stereo_depth(flat(0.8), FX, noise, np.random.default_rng(2))
    steps = FX * noise.baseline / measured.astype(float) / noise.step_px
    assert np.abs(steps - np.round(steps)).max() < 0.01


def test_depth_edges_get_flying_and_lost_pixels_and_flat_parts_do_not():
    depth = flat(1.0)
    depth[:, 160:] = 0.6
    noise = DepthNoiseConfig(blob_share=0.0)
    measured = stereo_depth(depth, FX, noise, np.random.default_rng(3))
    beside, away = measured[:, 158:162], np.delete(measured, np.s_[156:164], axis=1)
    assert np.isnan(beside).mean() == pytest.approx(noise.edge_dropout_share, abs=0.04)
    # Means of 5 columns of which 1 to 4 are near lie between 0.65 and 0.88 m.
    between = (beside > 0.625) & (beside < 0.93)
    assert between.mean() == pytest.approx(noise.flying_share, abs=0.05)
    assert np.isfinite(away).all()
    assert not np.any((away > 0.66) & (away < 0.94))


def test_blobs_lose_the_stated_share_of_pixels_in_patches():
    noise = DepthNoiseConfig(blob_share=0.03)
    lost = np.isnan(stereo_depth(flat(0.8), FX, noise, np.random.default_rng(4)))
    assert lost.mean() == pytest.approx(0.03, abs=0.002)
    # In patches: a lost pixel's neighbour is lost as well, far more often than by chance.
    assert lost[:, 1:][lost[:, :-1]].mean() > 0.8


def test_depths_out_of_range_and_nothing_at_all_are_unknown():
    noise = DepthNoiseConfig(blob_share=0.0, nearest=0.3, farthest=3.0)
    for distance in (0.2, 5.0, np.nan, 0.0):
        assert np.isnan(stereo_depth(flat(distance, (20, 20)), FX, noise, np.random.default_rng(0))).all()


def test_the_same_generator_state_gives_the_same_noise():
    noise = DepthNoiseConfig()
    first, again = (stereo_depth(flat(0.8), FX, noise, np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(first, again, equal_nan=True)


def test_a_noisy_picture_of_a_cell_has_a_few_percent_of_unknown_pixels_and_changes_from_frame_to_frame():
    world = build_world(load_cell("cubes"), seed=0, meshes=False)
    first, second = (world.render("static")[1] for _ in range(2))
    world.close()
    assert 0.005 < np.isnan(first).mean() < 0.06
    assert not np.array_equal(first, second, equal_nan=True)
