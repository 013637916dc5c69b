"""Light left out for want of hits, in a hollow sphere that is open above: a geometric series."""

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import PerspectiveCamera, Trajectory
from megalopta.scenes.material import Material
from megalopta.scenes.scene import (
    Lighting,
    Scene,
)
from megalopta.scenes.spectra.spectrum import Spectrum, flat

from .conftest import scene_of

BANDS = (500.0, 600.0), (800.0, 900.0)
REFLECTANCES = 0.2, 0.8
DOWN = Trajectory(frames=2, look_at_m=(0.01, 0, -50), up=(1, 0, 0)).poses()[0]


def renderer(max_depth, scene_part=0.625):
    """Of walls that are a part of a sphere, dim in one band and bright in the other."""
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=200.0)
    highest = np.sort(sphere.triangles_center[:, 2])[round(scene_part * len(sphere.faces)) - 1]
    sphere.update_faces(sphere.triangles_center[:, 2] <= highest)
    wall = Spectrum((400.0, 650.0, 750.0, 1000.0), np.repeat(REFLECTANCES, 2).tolist())
    scene = scene_of(Lighting(flat(1.0)), (sphere, Material(wall)))
    camera = PerspectiveCamera(width=48, height=48, fov_deg=60)
    settings = RenderSettings(bands_nm=BANDS, samples_per_pixel=64, max_depth=max_depth)
    return SceneRenderer(scene, camera, settings)


@pytest.mark.parametrize("max_depth", [2, 3, 5])
def test_share_is_the_rest_of_a_geometric_series(max_depth):
    # Every place in a sphere gets equally much of every other: of the light that leaves the walls,
    # their share of the sphere comes back, and each hit keeps the reflectance of it.
    kept = 0.625 * np.array(REFLECTANCES)
    # Of 35 000 paths one in 2 to 16 goes on in the bright band: up to 3 % (σ), four of them.
    expected = kept ** (max_depth - 1)
    found = renderer(max_depth).light_left_out(DOWN)
    np.testing.assert_allclose(found, expected, rtol=0.12, atol=1e-3)


def test_nothing_is_left_out_where_there_is_nothing_to_hit():
    scene = Scene({}, {}, (), Lighting(flat(1.0)))
    camera = PerspectiveCamera(width=16, height=16)
    empty = SceneRenderer(scene, camera, RenderSettings(bands_nm=BANDS, max_depth=2))
    np.testing.assert_array_equal(empty.light_left_out(DOWN), 0.0)
