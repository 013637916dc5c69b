"""The leaf area that is asked for is there."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from megalopta.scenes.forest.canopy import ground_area, plant_area
from megalopta.scenes.forest.description import Forest, build_forest
from megalopta.scenes.forest.flora import PRESETS
from megalopta.scenes.forest.planting import dense_path

PATH = np.array([[-1.0, 0], [4, 1]])


def measured(forest):
    return plant_area(build_forest(forest, PATH), PATH, forest.canopy_ring_m)


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_presets_have_their_leaf_area_and_a_tree_s_share_of_wood(name):
    forest = Forest(preset=name)
    found = measured(forest)
    # Where a leaf is was asked of 200 leaves of a plant; some were then lost at random.
    assert found.leaf_area_index == pytest.approx(forest.leaf_area_index, rel=0.03)
    assert 0.1 < found.wood_share < 0.26


@pytest.mark.slow
@pytest.mark.parametrize("detail", [0.1, 1.0, 10.0])
def test_leaf_area_is_met_at_any_detail(detail):
    forest = Forest(trees=60, density_per_ha=700, leaf_area_index=2.5, detail=detail, undergrowth=0)
    assert measured(forest).leaf_area_index == pytest.approx(2.5, rel=0.03)


def test_ground_around_a_straight_path_is_a_strip_with_round_ends():
    length = np.linalg.norm(PATH[1] - PATH[0])
    expected = np.pi * (9**2 - 2**2) + 2 * (9 - 2) * length
    path = cKDTree(dense_path(PATH))
    # a grid of 0.2 m around 70 m of border; the path is points half a meter apart
    assert ground_area(path, (2.0, 9.0)) == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_more_leaves_than_trees_can_carry_are_refused():
    thin = Forest(trees=8, density_per_ha=80, leaf_area_index=12, undergrowth=0, detail=0.05)
    with pytest.raises(ValueError, match="leaf_area_index: 12 is more than .* density_per_ha"):
        build_forest(thin, PATH)
