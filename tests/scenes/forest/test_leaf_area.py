"""The leaf area that is asked for is there."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from megalopta.assets_gen.scatter import distance_to
from megalopta.scenes.forest.description import Forest, build_forest
from megalopta.scenes.forest.flora import PRESETS, SMALL
from megalopta.scenes.forest.planting import dense_path
from megalopta.scenes.forest.specimens import RING_M, ground_area

PATH = np.array([[-1.0, 0], [4, 1]])


def measured(forest):
    """Area of the leaves of woody plants, triangle by triangle, and wood over all of it."""
    scene, path = build_forest(forest, PATH), cKDTree(dense_path(PATH))
    near, far = forest.clearance_m, forest.clearance_m + RING_M
    area = {"leaf": 0.0, "bark": 0.0}
    for placement in scene.placements:
        for part, mesh in scene.assets[placement.asset].parts.items():
            organ = part.rpartition(" ")[2]
            if placement.kind in SMALL or organ not in area:
                continue
            corners = mesh.vertices[mesh.faces] @ placement.to_world[:3, :3].T
            a, b, c = (corners + placement.to_world[:3, 3]).swapaxes(0, 1)
            away = distance_to(path, (a + b + c)[:, :2] / 3)
            sizes = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
            area[organ] += sizes[(away >= near) & (away < far)].sum()
    leaf, wood = area["leaf"] / ground_area(path, (near, far)), area["bark"] / 2
    return leaf, wood / (wood + area["leaf"])


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_presets_have_their_leaf_area_and_a_tree_s_share_of_wood(name):
    forest = Forest(preset=name)
    leaf_area_index, wood_share = measured(forest)
    # Where a leaf is was asked of 200 leaves of a plant; some were then lost at random.
    assert leaf_area_index == pytest.approx(forest.leaf_area_index, rel=0.03)
    assert 0.1 < wood_share < 0.26


@pytest.mark.slow
@pytest.mark.parametrize("detail", [0.1, 1.0, 10.0])
def test_leaf_area_is_met_at_any_detail(detail):
    forest = Forest(trees=60, density_per_ha=700, leaf_area_index=2.5, detail=detail, undergrowth=0)
    assert measured(forest)[0] == pytest.approx(2.5, rel=0.03)


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
