import numpy as np
import pytest
from scipy.spatial import cKDTree
from skimage.draw import polygon

from megalopta.assets_gen.plants.detail import Detail, coarsened, merged_leaves, some_leaves
from megalopta.assets_gen.plants.growth import grow_plant
from megalopta.scenes.forest.flora import BUSHES, TREES

WOODY = {name: plant.shape for name, plant in {**TREES, **BUSHES}.items()}
COARSE = Detail(leaf_m2=0.026, merged=8, thinnest_m=0.012, chord_m=0.14)


@pytest.fixture(params=["beech", "spruce", "hazel"], scope="module")
def plant(request):
    return grow_plant(WOODY[request.param], np.random.default_rng(4))


def coarse(plant, detail=COARSE):
    return coarsened(plant, detail, np.random.default_rng(5))


def shadow(surfaces, height_m, texels=250):
    """Which texels of a picture from the side surfaces cover; a texel is a point, not a box."""
    image = np.zeros((texels, texels), dtype=bool)
    scale = texels / (1.25 * height_m)
    for surface in surfaces:
        x = surface.vertices[:, 0] * scale + texels / 2
        y = surface.vertices[:, 2] * scale + 0.05 * texels
        for face in surface.faces:
            image[polygon(y[face], x[face], image.shape)] = True
    return image


def test_merging_leaves_keeps_their_total_area_exactly(plant):
    merged = merged_leaves(plant.leaves, 7, np.random.default_rng(0))
    assert merged.area == pytest.approx(plant.leaves.area, rel=1e-9)
    assert len(merged.faces) == -(-len(plant.leaves.faces) // 2 // 7)


def test_a_crown_covers_as_much_of_the_sky_when_coarse(plant):
    height = plant.species.height_m
    fine, rough = (
        shadow(surfaces, height).sum() for surfaces in ((plant.wood, plant.leaves), coarse(plant))
    )
    # Leaves as large as a clump overlap less than the clump's own: up to 15 % more is covered; some
    # hundred of them in random places add a scatter of 3 % in one view.
    assert rough == pytest.approx(fine, rel=0.18)


def test_merged_twigs_have_the_surface_of_all_twigs(plant):
    wood, _ = coarse(plant, Detail(leaf_m2=0.02, merged=4, thinnest_m=1e9, chord_m=0.0))
    # a wider twig may get more sides: 3 have 0.5 % more area at its pointed end than 4 of one width
    assert wood.area == pytest.approx(plant.wood.area, rel=0.04)


def test_some_leaves_have_their_share_of_the_area_and_are_whole(plant):
    merged = merged_leaves(plant.leaves, 3, np.random.default_rng(0))
    for leaves, corners in ((plant.leaves, 4), (merged, 3)):
        few, more = (some_leaves(leaves, share, np.random.default_rng(2)) for share in (0.3, 0.6))
        # areas scatter by a third of their mean: five deviations, false alarms below 6e-7
        tolerance = 5 * 0.35 / np.sqrt(0.3 * len(leaves.vertices) / corners)
        assert few.area == pytest.approx(0.3 * leaves.area, rel=tolerance)
        own = {leaf.tobytes() for leaf in more.vertices.reshape(-1, corners, 3)}
        assert {leaf.tobytes() for leaf in few.vertices.reshape(-1, corners, 3)} < own
        everything = {leaf.tobytes() for leaf in leaves.vertices.reshape(-1, corners, 3)}
        assert own < everything


def test_leaves_stay_in_their_cluster_when_thinned_and_merged(plant):
    whole = plant.leaves
    middles = whole.vertices.reshape(-1, 4, 3).mean(axis=1)
    cluster_at = {
        place.tobytes(): own for place, own in zip(middles, whole.clusters[::2], strict=True)
    }
    assert len(set(cluster_at.values())) > 20
    few = some_leaves(whole, 0.3, np.random.default_rng(2))
    found = few.vertices.reshape(-1, 4, 3).mean(axis=1)
    assert [cluster_at[place.tobytes()] for place in found] == few.clusters[::2].tolist()
    merged = merged_leaves(whole, 7, np.random.default_rng(0))
    # A merged leaf lies at the middle of one of its leaves.
    nearest = cKDTree(middles).query(merged.vertices.reshape(-1, 3, 3).mean(axis=1))[1]
    np.testing.assert_array_equal(whole.clusters[2 * nearest], merged.clusters)
