import numpy as np
import pytest
from scipy.spatial import cKDTree

from megalopta.assets_gen.scatter import poisson_disk

LOW, HIGH = np.array([-10.0, 5.0]), np.array([30.0, 25.0])


def strew(count=300, spacing_m=1.1, seed=0):
    return poisson_disk(LOW, HIGH, count, spacing_m, np.random.default_rng(seed))


def test_points_keep_their_distance_and_number_inside_the_box():
    points = strew()
    nearest = cKDTree(points).query(points, k=2)[0][:, 1]
    assert points.shape == (300, 2)
    assert nearest.min() >= 1.1
    assert np.all((points >= LOW) & (points <= HIGH))


def test_points_depend_on_the_seed_alone():
    assert np.array_equal(strew(seed=4), strew(seed=4))
    assert not np.array_equal(strew(seed=4), strew(seed=5))


def test_a_pattern_that_cannot_fit_is_refused():
    with pytest.raises(ValueError, match="spacing_m: 300 points 2 m apart do not fit"):
        strew(spacing_m=2.0)
