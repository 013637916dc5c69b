import numpy as np
import pytest
from scipy.spatial import cKDTree

from megalopta.assets_gen.terrain import ground_surface, make_terrain

PATH = np.stack([np.linspace(-1, 5, 13), np.zeros(13)], axis=-1)
LOW, HIGH = np.array([-8.0, -7.0]), np.array([12.0, 7.0])


@pytest.fixture(scope="module")
def terrain():
    return make_terrain(cKDTree(PATH), 0.8, (25, 45), 7, np.random.default_rng(3))


@pytest.fixture(scope="module")
def ground(terrain):
    return ground_surface(terrain, LOW, HIGH, 0.5, 100)


def test_the_path_is_level_and_the_land_beside_it_rolls(terrain):
    # bumps: 3.5 cm root mean square, less than four times that
    assert np.abs(terrain.height(PATH)).max() < 0.15
    azimuth = np.linspace(0, 2 * np.pi, 200)
    ring = 20 * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1) + (2, 0)
    assert np.ptp(terrain.height(ring)) > 0.8


def test_the_mesh_lies_on_the_height_field_and_reaches_the_horizon(terrain, ground):
    np.testing.assert_array_equal(terrain.height(ground.vertices[:, :2]), ground.vertices[:, 2])
    assert np.all(ground.vertices[:, :2].min(axis=0) <= LOW - 100)
    assert np.all(ground.vertices[:, :2].max(axis=0) >= HIGH + 100)


def test_the_ground_faces_up_and_its_normals_with_it(ground):
    faces = ground.to_mesh().face_normals
    assert faces[:, 2].min() > 0.5
    np.testing.assert_allclose(np.linalg.norm(ground.normals, axis=1), 1, rtol=1e-12)
    agreement = (ground.normals[ground.faces] @ faces[:, :, None]).min(axis=(1, 2))
    near = np.abs(ground.vertices[ground.faces, :2]).max(axis=(1, 2)) < 40
    assert agreement[near].min() > 0.8 and agreement.min() > 0
