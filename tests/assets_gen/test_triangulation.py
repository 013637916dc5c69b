import numpy as np
import pytest
from scipy.spatial import cKDTree

from megalopta.assets_gen.scatter import distance_to
from megalopta.assets_gen.triangulation import Fineness, triangulated

PATH = cKDTree(np.stack([np.linspace(0, 3, 13), np.linspace(0, 1, 13)], axis=-1))
FINE = Fineness(finest_m=0.1, near_m=1.5)
REACH_M = 30.0


@pytest.fixture(scope="module")
def mesh():
    return triangulated(PATH, FINE, REACH_M, np.random.default_rng(4))


def test_triangles_face_up_and_leave_no_gap(mesh):
    assert mesh.areas.min() > 0
    # What surrounds the path by 29 m is covered once: area by area, to the band that is left.
    x, y = (mesh.points[:, i] for i in range(2))
    hull = np.ptp(x) * np.ptp(y)
    assert mesh.areas.sum() < hull
    near = distance_to(PATH, mesh.centers) < REACH_M - 1
    length = np.linalg.norm([3, 1])
    expected = np.pi * (REACH_M - 1) ** 2 + 2 * length * (REACH_M - 1)
    # The path's points stand for its line, and triangles for places: to half a percent.
    assert mesh.areas[near].sum() == pytest.approx(expected, rel=5e-3)


def test_every_inner_edge_has_two_triangles(mesh):
    edges = np.sort(
        np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    )
    _, times = np.unique(edges, axis=0, return_counts=True)
    assert times.max() == 2
    corners, edge = len(mesh.points), len(times)
    assert corners - edge + len(mesh.faces) == 1  # Euler: a disc without holes


def test_the_number_of_triangles_is_foreseen(mesh):
    assert len(mesh.faces) == pytest.approx(FINE.triangles(np.hypot(3, 1), REACH_M), rel=0.15)


def test_a_plane_is_interpolated_exactly_and_places_outside_are_refused(mesh):
    def height(points):
        return 2 + points @ (0.3, -0.7)

    places = np.random.default_rng(0).uniform(-15, 15, (2000, 2))
    found = mesh.interpolated(height(mesh.points), places)
    np.testing.assert_allclose(found, height(places), atol=1e-9)
    with pytest.raises(ValueError, match="places: 1 lie outside"):
        mesh.interpolated(height(mesh.points), np.array([[500.0, 0.0]]))
