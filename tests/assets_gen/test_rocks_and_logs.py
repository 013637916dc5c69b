import numpy as np
import pytest

from megalopta.assets_gen.plants.undergrowth import grow_log
from megalopta.assets_gen.rocks import grow_rock

from .conftest import welded

SEEDS = range(6)


@pytest.mark.parametrize("seed", SEEDS)
def test_rocks_are_closed_solids_about_a_meter_wide_half_in_the_ground(seed):
    surface = grow_rock(np.random.default_rng(seed))
    mesh = welded(surface)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    assert 0.6 < np.ptp(surface.vertices[:, 0]) < 1.4
    low, high = surface.vertices[:, 2].min(), surface.vertices[:, 2].max()
    assert low < -0.1 and 0.15 < high < 0.7


@pytest.mark.parametrize("seed", SEEDS)
def test_normals_of_rocks_point_out(seed):
    surface = grow_rock(np.random.default_rng(seed))
    faces = surface.to_mesh().face_normals
    agreement = np.sum(surface.normals[surface.faces].mean(axis=1) * faces, axis=1)
    # the base, which lies in the ground, is flat while its rim's normals are not
    sides = 28
    assert agreement[: -(sides - 2)].min() > 0.3


def test_a_coarse_rock_is_the_same_rock():
    fine, rough = (grow_rock(np.random.default_rng(1), sides) for sides in (56, 14))
    # chords cut off the more the fewer there are: 14 sides enclose 0.93 of a circle
    assert welded(rough).volume == pytest.approx(welded(fine).volume, rel=0.15)
    assert len(rough.faces) < len(fine.faces) / 10


@pytest.mark.parametrize("seed", SEEDS)
def test_a_log_lies_on_the_ground_a_little_sunk(seed):
    bark, ends = grow_log(np.random.default_rng(seed))
    x, _, z = bark.vertices.T
    assert 3 <= np.ptp(x) <= 7.7
    middle = abs(x) < np.ptp(x) / 4
    assert -0.15 < z[middle].min() < 0
    assert ends.vertices[:, 2].max() > 0.1


def test_the_ends_of_a_log_face_outward_along_it():
    _, ends = grow_log(np.random.default_rng(0))
    facing = ends.to_mesh().face_normals[:, 0] * np.sign(ends.to_mesh().triangles_center[:, 0])
    assert facing.min() > 0.9
