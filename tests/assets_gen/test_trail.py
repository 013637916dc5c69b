import numpy as np
import pytest

from megalopta.assets_gen.moss import cut_at, make_moss
from megalopta.assets_gen.tileable_noise import make_octaves
from megalopta.assets_gen.trail import make_trail

WAY = np.stack([np.linspace(0, 4, 9), np.zeros(9)], axis=-1)
WIDTH_M = 1.2


@pytest.fixture(scope="module")
def trail():
    return make_trail(WAY, np.array([0.0, 1.0]), WIDTH_M, 60.0, np.random.default_rng(2))


def grid(low, high, step):
    axes = [np.arange(a, b, step) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def test_the_mean_width_is_the_one_asked_for():
    widths = []
    for seed in range(12):
        trail = make_trail(WAY, np.array([1.0, 0.0]), WIDTH_M, 30.0, np.random.default_rng(seed))
        points = grid((0, -2), (4, 2), 0.05)
        widths.append((trail.inside(points) > 0).sum() * 0.05**2 / 4)
    # Margins of 0.14 m rms in waves of up to 4 m: a trail's mean varies by about 0.1 m.
    assert np.mean(widths) == pytest.approx(WIDTH_M, abs=0.15)


def test_it_goes_on_beyond_both_ends_in_the_direction_of_the_way(trail):
    line = trail.line.data
    assert line[:, 0].min() < -20 and line[:, 0].max() > 24
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).max() < 0.51


def test_around_one_place_it_follows_the_heading():
    still = np.zeros((1, 2))
    trail = make_trail(still, np.array([0.0, 3.0]), WIDTH_M, 20.0, np.random.default_rng(0))
    near = trail.line.data[np.linalg.norm(trail.line.data, axis=1) < 1.5]
    assert np.abs(near[:, 0]).max() < 0.2 and near[:, 1].min() < -1.2 < 1.2 < near[:, 1].max()


def test_the_middle_is_worn_and_the_land_beside_is_not(trail):
    assert trail.sunk(np.array([-2.0, 0.6]))[0] == 0
    assert 0.05 < trail.sunk(trail.inside(WAY)).min() <= 0.06


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
    favor = make_moss(np.array([[2.0, 2.0]]), rng).favor(points, np.full(5000, 0.02))
    where = points[:, 0] > 0
    covered = (favor > cut_at(favor, areas, where, share)) & where
    # to one of some 2500 triangles
    assert areas[covered].sum() / areas[where].sum() == pytest.approx(share, abs=1e-3)


def test_moss_prefers_the_feet_of_trees():
    rng = np.random.default_rng(5)
    trees = rng.uniform(-20, 20, (200, 2))
    moss = make_moss(trees, rng)
    steps = np.full(200, 0.02)
    away = trees + np.array([1.5, 0.0])
    assert moss.favor(trees, steps).mean() > moss.favor(away, steps).mean() + 0.8
