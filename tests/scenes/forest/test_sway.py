import numpy as np
import pytest

from megalopta.scenes.forest.description import Forest, build_forest
from megalopta.scenes.forest.flora import BUSHES, TREES
from megalopta.scenes.forest.sway import FREQUENCY_SPREAD, FREQUENCY_TIMES_HEIGHT, Sway, Wind

STAND = Forest(
    trees=8, density_per_ha=80, mix={"birch": 1, "spruce": 1}, undergrowth=0.02, detail=0.05
)
PATH = [[0.0, 0.0], [2.0, 0.0]]
TREE = Sway((3.0, 4.0, 1.0), 20.0, (0.0, 1.0), 0.3, 0.31, (0.4, 1.1))


@pytest.fixture(scope="module")
def windy():
    forest = STAND.model_copy(update={"wind": Wind(amplitude_m=0.4, seed=3)})
    return build_forest(forest, PATH)


def way(points, time):
    return TREE.carry(points, time) - points


def test_bending_grows_with_the_square_of_the_height_and_keeps_the_foot():
    points = np.array([[3.0, 4, 1], [3, 4, 6], [3, 4, 11], [3, 4, 21], [3, 4, 0.5]])
    ways = way(points, 0.9)
    top = ways[3, :2]
    np.testing.assert_allclose(ways[:, :2], np.outer([0, 1 / 16, 1 / 4, 1, 0], top), atol=1e-12)
    assert (ways[:, 2] == 0).all()


def test_the_top_reaches_its_amplitude_along_the_wind_and_less_across():
    times = np.arange(0, 200, 0.05)
    tops = np.array([way(np.array([[3.0, 4, 21]]), time)[0] for time in times])
    np.testing.assert_allclose(np.abs(tops).max(axis=0), [0.12, 0.3, 0], rtol=1e-3, atol=1e-12)


def test_trees_and_bushes_sway_each_in_its_own_way_and_nothing_else_does(windy):
    moving = [placement for placement in windy.placements if placement.motion]
    assert {placement.kind for placement in moving} <= {*TREES, *BUSHES}
    assert all(
        placement.motion for placement in windy.placements if placement.kind in {*TREES, *BUSHES}
    )
    assert len({placement.motion.phases_rad for placement in moving}) == len(moving)
    for placement in moving:
        sway = placement.motion
        assert sway.amplitude_m == pytest.approx(0.4 * sway.height_m / 20)
        product = sway.frequency_hz * sway.height_m / FREQUENCY_TIMES_HEIGHT
        assert abs(product - 1) <= FREQUENCY_SPREAD
    tallest = max(placement.motion.height_m for placement in moving)
    assert 12 < tallest < 40


def test_wind_changes_nothing_but_the_motion(windy):
    calm = build_forest(STAND, PATH)
    assert [each.asset for each in calm.placements] == [each.asset for each in windy.placements]
    assert not calm.is_moving
    assert windy.is_moving
