"""A forest with a path, moss, relief and furrows is rendered like any other."""

import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer, choose_variant
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene

pytestmark = pytest.mark.slow

FOREST = Forest(
    trees=30,
    density_per_ha=900,
    mix={"oak": 1},
    undergrowth_per_m2={"litter": 2, "fern": 0.3},
    detail=0.1,
    floor_relief_m=0.04,
    moss_share=0.4,
    path_width_m=1,
    bark_relief=1,
)
CAMERA = PerspectiveCamera(width=24, height=18, fov_deg=60)
WAY = Trajectory(frames=4, position_m=(0, 0, 1.5), look_at_m=(3, 0, 0), rotation_deg_s=10)
POSES = WAY.poses()
COMMON = {"samples_per_pixel": 64, "max_depth": 3, "bands_nm": ((500.0, 600.0),)}


@pytest.fixture(scope="module")
def scene():
    return build_scene(FOREST, Light(level="daylight"), CAMERA, WAY)


@pytest.fixture(scope="module")
def traced(scene):
    return SceneRenderer(scene, CAMERA, RenderSettings(integrator="path", **COMMON), POSES)


def test_its_ground_is_one_object_and_flow_on_it_follows_its_depth(traced):
    truth = traced.truth(POSES, 1, WAY.times_s)
    ground = truth.object_id == 1
    assert ground[-8:].mean() > 0.8
    # A turn about the camera moves directions alike, whatever their depth.
    directions = CAMERA.directions().reshape(-1, 3)
    turned = directions @ (POSES[2, :3, :3].T @ POSES[1, :3, :3]).T
    focal = CAMERA.focal_length_px
    flow = focal * (turned[:, :2] / turned[:, 2:] - directions[:, :2] / directions[:, 2:])
    np.testing.assert_allclose(
        truth.flow_forward[ground], flow.reshape(*ground.shape, 2)[ground], atol=1e-3
    )


@pytest.mark.skipif(choose_variant().name.startswith("scalar"), reason="baking needs vectors")
def test_baked_light_on_it_is_that_of_traced_paths(scene, traced):
    settings = RenderSettings(integrator="baked", bake_error=0.1, **COMMON)
    baked = SceneRenderer(scene, CAMERA, settings, POSES)
    assert baked.integrator == "baked"
    quick, paths = (
        np.mean([each.radiance(POSES[1], seed)[..., 0] for seed in range(4)], axis=0)
        for each in (baked, traced)
    )
    # 10 % of error of baked light, in pixels that share clusters.
    assert quick.mean() == pytest.approx(paths.mean(), rel=0.1)
    assert np.corrcoef(quick.ravel(), paths.ravel())[0, 1] > 0.95
