"""Furnace tests: in an even environment whatever reflects all light cannot be seen."""

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import PerspectiveCamera, Trajectory
from megalopta.scenes.material import Material
from megalopta.scenes.scene import (
    Lighting,
)
from megalopta.scenes.spectra.spectrum import flat

from .conftest import scene_of

LEVEL = 2e-9
LOOKING = Trajectory(frames=2, position_m=(-4, 0.5, 1.0), look_at_m=(0, 0, 0)).poses()[0]


def furnace(mesh, reflectance, max_depth, bands=((500.0, 600.0),), samples=256, seed=1):
    scene = scene_of(Lighting(flat(LEVEL)), (mesh, Material(reflectance)))
    settings = RenderSettings(bands_nm=bands, samples_per_pixel=samples, max_depth=max_depth)
    camera = PerspectiveCamera(width=64, height=64, fov_deg=30)
    return SceneRenderer(scene, camera, settings).radiance(LOOKING, seed)


def test_white_sphere_vanishes_in_its_environment():
    image = furnace(trimesh.creation.icosphere(subdivisions=4), flat(1.0), 2)
    assert image.mean(dtype=np.float64) == pytest.approx(LEVEL, rel=1e-3)  # required: 0.1 %
    np.testing.assert_allclose(image[..., 0], LEVEL, rtol=0.1)  # nor is its outline seen


@pytest.mark.parametrize("albedo", [0.2, 0.7])
def test_gray_sphere_has_its_albedo_times_the_environment(albedo):
    image = furnace(trimesh.creation.icosphere(subdivisions=4), flat(albedo), 2)
    center = image[24:40, 24:40].mean(dtype=np.float64)
    assert center == pytest.approx(albedo * LEVEL, rel=2e-3)  # 65 000 paths: σ below 0.05 %


@pytest.mark.slow
def test_white_open_box_vanishes_in_its_environment():
    box = trimesh.creation.box((2, 2, 2))
    box.update_faces(box.face_normals[:, 0] > -0.5)  # open toward the camera
    # A path stays inside with a chance below 0.8 a bounce: 64 bounces leave less than 1e-6.
    image = furnace(box, flat(1.0), 65)
    assert image.mean(dtype=np.float64) == pytest.approx(LEVEL, rel=1e-3)
