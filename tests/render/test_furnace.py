"""Furnace tests: in an even environment whatever reflects all light cannot be seen."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import PerspectiveCamera, Trajectory
from megalopta.scenes.material import Material
from megalopta.scenes.scene import (
    Asset,
    Lighting,
    Placement,
    Scene,
)
from megalopta.scenes.spectra.spectrum import Spectrum, flat

LEVEL = 2e-9
LOOKING = Trajectory(frames=2, position_m=(-4, 0.5, 1.0), look_at_m=(0, 0, 0)).poses()[0]


def furnace(mesh, reflectance, max_depth, bands=((500.0, 600.0),), samples=256, seed=1):
    scene = Scene(
        {"white": Material(reflectance)},
        {"thing": Asset({"white": mesh})},
        (Placement("thing", "thing", np.eye(4)),),
        Lighting(flat(LEVEL)),
    )
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


@pytest.mark.slow
def test_bands_sum_to_the_one_band_rendering_within_monte_carlo_error():
    leaf = Spectrum((400.0, 550.0, 700.0), (0.2, 0.9, 0.5))
    sphere = trimesh.creation.icosphere(subdivisions=3)
    edges = (400.0, 475.0, 550.0, 625.0, 700.0)
    bands = tuple(pairwise(edges))
    many, one = (
        np.array([furnace(sphere, leaf, 3, b, 9, seed).mean(axis=(0, 1)) for seed in range(16)])
        for b in (bands, ((400.0, 700.0),))
    )
    sums, whole = many.mean(axis=1, dtype=np.float64), one[:, 0].astype(np.float64)
    error = np.hypot(sums.std(ddof=1), whole.std(ddof=1)) / np.sqrt(16)
    # Student's t of at least 15 degrees of freedom exceeds 8.5 with a chance of 4e-7.
    assert abs(sums.mean() - whole.mean()) < 8.5 * error
    assert error < 1e-3 * LEVEL  # or the test would show nothing
