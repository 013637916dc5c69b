"""Bodies, rocks, surfaces and the ground."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from megalopta.assets_gen.bodies import ball, box, grow_rock
from megalopta.assets_gen.scatter import distance_to
from megalopta.assets_gen.terrain import cut_at, ground_surface, make_moss, make_terrain
from megalopta.assets_gen.tileable_noise import make_octaves
from megalopta.assets_gen.trail import make_trail
from megalopta.assets_gen.triangulation import Fineness, triangulated

from .conftest import welded


@pytest.mark.parametrize(("body", "volume"), [(box, 1.0), (ball, np.pi / 6)], ids=["box", "ball"])
def test_bodies_are_closed_face_outward_and_have_their_volume(body, volume):
    mesh = body((2.0, 1.0, 0.5), 0.25).to_mesh()
    # By the divergence theorem; a hole or a face turned inward would show. The ball's facets
    # cut off about (π/48)²/2 of its volume.
    assert mesh.volume == pytest.approx(volume, rel=4e-3)
    np.testing.assert_allclose(mesh.extents, (2.0, 1.0, 0.5), rtol=1e-3)
    assert (np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles_center) > 0).all()


SEEDS = range(3)


@pytest.mark.parametrize("seed", SEEDS)
def test_rocks_are_closed_solids_about_a_meter_wide_half_in_the_ground(seed):
    surface = grow_rock(np.random.default_rng(seed))
    mesh = welded(surface)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    assert 0.6 < np.ptp(surface.vertices[:, 0]) < 1.4
    low, high = surface.vertices[:, 2].min(), surface.vertices[:, 2].max()
    assert low < -0.1 and 0.15 < high < 0.7


PATH = np.stack([np.linspace(-1, 5, 13), np.zeros(13)], axis=-1)
LOW, HIGH = np.array([-8.0, -7.0]), np.array([12.0, 7.0])


@pytest.fixture(scope="module")
def terrain():
    return make_terrain(cKDTree(PATH), 0.8, (25, 45), 7, np.random.default_rng(3))


def test_the_path_is_level_and_the_land_beside_it_rolls(terrain):
    # bumps: 3.5 cm root mean square, less than four times that
    assert np.abs(terrain.height(PATH)).max() < 0.15
    azimuth = np.linspace(0, 2 * np.pi, 200)
    ring = 20 * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1) + (2, 0)
    assert np.ptp(terrain.height(ring)) > 0.8


def test_the_ground_faces_up_and_its_normals_with_it(terrain):
    ground = ground_surface(terrain, LOW, HIGH, 0.5, 100)
    faces = ground.to_mesh().face_normals
    assert faces[:, 2].min() > 0.5
    np.testing.assert_allclose(np.linalg.norm(ground.normals, axis=1), 1, rtol=1e-12)
    agreement = (ground.normals[ground.faces] @ faces[:, :, None]).min(axis=(1, 2))
    near = np.abs(ground.vertices[ground.faces, :2]).max(axis=(1, 2)) < 40
    assert agreement[near].min() > 0.8 and agreement.min() > 0


TRIANGULATION_PATH = cKDTree(np.stack([np.linspace(0, 3, 13), np.linspace(0, 1, 13)], axis=-1))
FINE = Fineness(finest_m=0.1, near_m=1.5)
REACH_M = 30.0


@pytest.fixture(scope="module")
def mesh():
    return triangulated(TRIANGULATION_PATH, FINE, REACH_M, np.random.default_rng(4))


def test_triangles_face_up_and_leave_no_gap(mesh):
    assert mesh.areas.min() > 0
    # What surrounds the path by 29 m is covered once: area by area, to the band that is left.
    x, y = (mesh.points[:, i] for i in range(2))
    hull = np.ptp(x) * np.ptp(y)
    assert mesh.areas.sum() < hull
    near = distance_to(TRIANGULATION_PATH, mesh.centers) < REACH_M - 1
    length = np.linalg.norm([3, 1])
    expected = np.pi * (REACH_M - 1) ** 2 + 2 * length * (REACH_M - 1)
    # The path's points stand for its line, and triangles for places: to half a percent.
    assert mesh.areas[near].sum() == pytest.approx(expected, rel=5e-3)


def test_a_plane_is_interpolated_exactly_and_places_outside_are_refused(mesh):
    def height(points):
        return 2 + points @ (0.3, -0.7)

    places = np.random.default_rng(0).uniform(-15, 15, (2000, 2))
    found = mesh.interpolated(height(mesh.points), places)
    np.testing.assert_allclose(found, height(places), atol=1e-9)
    with pytest.raises(ValueError, match="places: 1 are outside"):
        mesh.interpolated(height(mesh.points), np.array([[500.0, 0.0]]))


WAY = np.stack([np.linspace(0, 4, 9), np.zeros(9)], axis=-1)
WIDTH_M = 1.2


def test_a_trail_has_its_mean_width_and_is_worn_in_its_middle():
    widths, depths = [], []
    for seed in range(12):
        trail = make_trail(WAY, np.array([1.0, 0.0]), WIDTH_M, 30.0, np.random.default_rng(seed))
        points = np.stack(np.mgrid[0:4:0.05, -2:2:0.05], axis=-1).reshape(-1, 2)
        widths.append((trail.inside(points) > 0).sum() * 0.05**2 / 4)
        assert trail.sunk(np.array([-2.0]))[0] == 0  # beside it
        depths.append(trail.sunk(trail.inside(WAY)).max())
    # Margins of 0.14 m rms in waves of up to 4 m: a trail's mean varies by about 0.1 m.
    assert np.mean(widths) == pytest.approx(WIDTH_M, abs=0.15)
    np.testing.assert_allclose(depths, 0.06, rtol=0.1)  # wear in its middle


def test_a_rough_field_has_its_root_mean_square_where_a_mesh_shows_it():
    rough = make_octaves((((0.5, 1.0), 2.0), ((0.2, 0.5), 1.0)), 0.03, np.random.default_rng(1))
    points = np.random.default_rng(0).uniform(-50, 50, (4000, 2))
    fine, coarse = (rough(points, np.full(4000, step)) for step in (0.05, 0.5))
    # 4000 places that are about independent: 1.1 % standard error, five of these
    assert fine.std() == pytest.approx(0.03, rel=0.056)
    assert not coarse.any()


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_moss_is_cut_where_it_covers_its_share(share):
    rng = np.random.default_rng(3)
    points, areas = rng.uniform(-10, 10, (5000, 2)), rng.uniform(0.5, 1.5, 5000)
    favor = make_moss(np.array([[2.0, 2.0]]), rng)(points, np.full(5000, 0.02))
    where = points[:, 0] > 0
    covered = (favor > cut_at(favor, areas, where, share)) & where
    # to one of some 2500 triangles
    assert areas[covered].sum() / areas[where].sum() == pytest.approx(share, abs=1e-3)
