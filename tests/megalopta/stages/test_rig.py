"""Cameras of a rig see the same scene from their own places, and pairs know their disparity."""

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh
import yaml
from scipy.spatial.transform import Rotation

import megalopta
from megalopta.config.model import parse
from megalopta.config.recipe import Plan
from megalopta.core.errors import UserError
from megalopta.dataset.opened import FlowPairs
from megalopta.render import read_truth
from megalopta.stages.make import make
from megalopta.stages.render import build

pytestmark = pytest.mark.slow

BASELINE_M = 0.3
TURN_DEG = (0.0, 70.0, 10.0)
SIZE = {"width": 40, "height": 30}


HUT = """
sequences: 6
scenes: [{{preset: grating, scene: {{kind: meshes, files: ["{folder}/hut.glb"], ground: 0.2}}}}]
cameras: [{size}]
trajectories:
- {{kind: steady, up: [0, 0.1, 1], position_m: [-3, 0, 1], look_at_m: [0, 0.2, 0.8], frames: 2,
    velocity_m_s: [0, 1, 0], rotation_deg_s: 20}}
every: {{render: {{samples_per_pixel: 1}}, scene: {{reflectance: {{uniform: [0.3, 0.6]}}}}}}
rig:
- {{}}
- {{position_m: [{baseline_m}, 0, 0]}}
- {{position_m: [0, 0.1, -0.2], rotation_deg: {turn_deg}}}
sensors: [ideal]
flow_files: [kitti_png]
"""


def plan_of(folder):
    trimesh.Scene({"hut": trimesh.creation.box((1, 1, 2))}).export(folder / "hut.glb")
    given = {"size": SIZE, "baseline_m": BASELINE_M, "turn_deg": [*TURN_DEG]}
    return Plan.model_validate(yaml.safe_load(HUT.format(folder=folder, **given)))


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    make(folder / "data", plan_of(folder), only=[0, 1, 2])
    return megalopta.open_dataset(folder / "data")


def test_cameras_of_a_path_are_found(rig):
    assert rig.paths == [("000000", "000001", "000002")]
    table = pq.read_table(rig.root / "index/sequences.parquet")
    assert [table[name].to_pylist() for name in ("path", "camera")] == [[0, 0, 0], [0, 1, 2]]
    assert "disparity" not in rig.pairs()[0]  # the third camera has none
    pair = FlowPairs([rig[0], rig[1]], None, 1)[0]
    np.testing.assert_array_equal(pair["disparity"], rig[0].disparity[0])


def test_disparity_is_focal_length_times_baseline_over_depth(rig):
    # Sintel's layout has steps of 2^-14 px; depth and flow are float32.
    for camera in rig[0], rig[1]:
        focal = camera.configuration.camera.focal_length_px
        expected = focal * BASELINE_M / camera.depth[1].astype(float)
        assert expected.max() > 3
        np.testing.assert_allclose(camera.disparity[1], expected, rtol=0, atol=2**-15 + 1e-6)
    with pytest.raises(UserError, match="no second camera side by side"):
        _ = rig[2].disparity


def test_points_hidden_from_the_right_camera_are_farther_than_what_it_sees(rig):
    left, right = rig[0], rig[1]
    mask = left.dataset.frame("training/occlusions_stereo", 0)
    hidden = cv2.imread(str(mask), cv2.IMREAD_UNCHANGED) > 0
    x = np.arange(SIZE["width"]) + 0.5 - left.disparity[0]
    outside = x <= 0
    assert hidden[outside].all()
    column = np.clip(x.astype(int), 0, SIZE["width"] - 1)
    seen = np.take_along_axis(right.depth[0], column, axis=1)
    depth = left.depth[0]
    behind = np.isfinite(depth) & (depth > 1.2 * seen) & ~outside
    assert behind.sum() > 5
    # What the nearest pixel's center sees may miss the point by half a pixel.
    assert hidden[behind].mean() > 0.8
    same = np.isfinite(depth) & (np.abs(1 / depth - 1 / seen) < 0.02 / seen)
    assert hidden[same & ~outside].mean() < 0.05


def test_kitti_s_layout_has_256_steps_a_pixel_and_no_unknown(rig):
    path = rig[0].dataset.frame("training/disparities_kitti", 0)
    stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    assert stored.min() == 1  # the sky
    np.testing.assert_allclose(stored / 256, rig[0].disparity[0], rtol=0, atol=1 / 256)


def test_a_mount_turns_about_the_path_s_camera_axes(rig):
    step = np.linalg.inv(rig[0].poses) @ rig[2].poses
    turn = Rotation.from_rotvec(TURN_DEG, degrees=True).as_matrix()
    np.testing.assert_allclose(step[:, :3, :3], np.broadcast_to(turn, (2, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(step[:, :3, 3], [[0, 0.1, -0.2]] * 2, atol=1e-6)


def test_other_paths_and_odd_pairs_are_refused(rig, tmp_path):
    with pytest.raises(ValueError, match="sequences 5: a rig of 3 cameras"):
        Plan.model_validate({**plan_of(tmp_path).model_dump(), "sequences": 5})
    above = {"stereo_with": "{position_m: [0, 0.2, 0]}"}
    with pytest.raises(UserError, match="do not look the same way side by side"):
        parse("name: a", "test", above)
    with pytest.raises(UserError, match="no lines along which to shift"):
        parse("camera: {kind: equirectangular}", "test", {"stereo_with": "{position_m: [1, 0, 0]}"})
    other = parse("name: other", "test")
    stranger = type(rig[0])(type(rig[0].dataset)(tmp_path, other))
    with pytest.raises(UserError, match="another scene or path"):
        rig[0].flow_to(stranger, 0)


MIXED = """
sequences: 4
scenes: [{preset: demo, scene: {kind: forest, trees: 6, density_per_ha: 60}}]
cameras: [{width: 40, height: 30}]
trajectories: [{frames: 2, velocity_m_s: [1, 0.5, 0]}]
every: {render: {samples_per_pixel: 1}}
rig:
- {}
- {position_m: [0.1, 0, 0], sensors: [ideal]}
- position_m: [0.2, 0, 0]
  camera: {width: 64, height: 20, fov_deg: 30}
  shutter: {readout_s: 0.05, readout_from: left}
- position_m: [0.3, 0, 0]
  camera: {kind: opencv, width: 24, height: 24, fisheye: [0.01, 0, 0, 0],
           fx_px: 18, fy_px: 18, cx_px: 12, cy_px: 12}
  render: {bands_nm: [[900, 1300], [1300, 1700]]}
  sensors: [ctia_ingaas_quiet]
light_levels: [full_moon]
"""


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mixed")
    plan = Plan.model_validate(yaml.safe_load(MIXED))
    make(folder / "data", plan)
    return megalopta.open_dataset(folder / "data")


def test_cameras_of_a_rig_have_their_own_lens_size_bands_shutter_and_sensor(mixed):
    assert [each.exposures for each in mixed] == [
        ("spadcam-full_moon",),
        ("ideal-full_moon",),
        ("spadcam-full_moon",),
        ("ctia_ingaas_quiet-full_moon",),
    ]
    shapes = [each.counts(each.exposures[0])[0].shape for each in mixed]
    assert shapes == [(30, 40), (30, 40), (20, 64), (24, 24)]
    assert [len(each.configuration.render.bands_nm) for each in mixed] == [4, 4, 4, 2]
    assert [each.dataset.exposed_truth(0).parent.parent.name for each in mixed] == [
        "truth", "truth", "truth_shutter", "truth",
    ]  # fmt: skip
    # At the first frame its columns look from up to 0.025 s along the path at 1.1 m/s.
    rolling = read_truth(mixed[2].dataset.exposed_truth(0)).position
    still = read_truth(mixed[2].dataset.frame("truth", 0)).position
    assert np.nanmax(np.abs(rolling - still)) > 0.01
    flow, known = mixed.pairs()[2]["flow"], np.moveaxis(mixed[2].flow(0), -1, 0)
    np.testing.assert_array_equal(flow, np.nan_to_num(known))  # of the shutter
    # Only the first two have the same lens.
    assert [each.configuration.stereo_with is None for each in mixed] == [False, False, True, True]


def test_different_cameras_see_the_same_scene(mixed):
    first, *others = (build(each.configuration) for each in mixed)
    for other in others:
        assert other.triangle_count == first.triangle_count
        for one, its in zip(other.placements, first.placements, strict=True):
            np.testing.assert_array_equal(one.to_world, its.to_world)


def test_flow_to_cameras_of_the_rig_is_that_of_projected_points(mixed):
    for start, end in ((0, 1), (0, 2), (0, 3), (3, 1)):
        truth, pose = read_truth(mixed[start].dataset.frame("truth", 0)), mixed[end].poses[1]
        points = (truth.position - pose[:3, 3]) @ pose[:3, :3]
        camera = mixed[end].configuration.camera
        image = camera.project(points.reshape(-1, 3)).reshape(*points.shape[:2], 2)
        rows, columns = np.indices(image.shape[:2]) + 0.5
        expected = image - np.stack([columns, rows], axis=-1)
        known = np.isfinite(expected[..., 0])
        assert known.sum() > 50
        error = mixed[start].flow_to(mixed[end], 0, 1)[known] - expected[known]
        # Depth and poses are float32.
        assert np.abs(error / (1 + np.abs(expected[known]))).max() < 1e-4


def test_a_camera_of_the_rig_that_does_not_fit_is_refused_before_any_is_made(tmp_path):
    plan = plan_of(tmp_path).model_dump(mode="json")
    plan["rig"][1]["camera"] = {"kind": "opencv"}
    with pytest.raises(UserError, match=r"sequence 1 .*camera\.width: missing"):
        make(tmp_path / "data", Plan.model_validate(plan))
    assert not (tmp_path / "data/sequences").exists()
