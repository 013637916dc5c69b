import numpy as np
import pytest

from megalopta.assets_gen.plants.undergrowth import (
    grow_bilberry,
    grow_fern,
    grow_flowers,
    grow_grass,
    grow_herbs,
    strew_litter,
)
from megalopta.assets_gen.surface import join

# plant, tallest (m), widest half (m), most triangles
PLANTS = {
    "fern": (grow_fern, 1.0, 1.1, 300),
    "bilberry": (grow_bilberry, 0.45, 0.95, 320),
    "flower": (lambda rng: join(grow_flowers(rng)), 0.3, 1.1, 300),
    "grass": (grow_grass, 0.65, 0.9, 84),
    "herb": (grow_herbs, 0.3, 1.2, 150),
    "litter": (strew_litter, 0.1, 0.8, 100),
}


@pytest.fixture(params=PLANTS)
def plant(request):
    return PLANTS[request.param]


def test_small_plants_have_their_size_and_stand_on_the_ground(plant):
    grow, tallest, half, triangles = plant
    for seed in range(5):
        surface = grow(np.random.default_rng(seed))
        z = surface.vertices[:, 2]
        assert -0.1 < z.min() < 0.15 and tallest / 4 < z.max() < tallest
        assert np.hypot(*surface.vertices[:, :2].T).max() < half
        assert len(surface.faces) <= triangles


def test_same_random_stream_grows_the_same_bytes(plant):
    first, second = (plant[0](np.random.default_rng(2)) for _ in range(2))
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.uv.tobytes() == second.uv.tobytes()


def test_merged_blades_of_grass_cover_as_much_with_fewer_triangles():
    tufts = [[grow_grass(np.random.default_rng(n), merged) for n in range(40)] for merged in (1, 4)]
    fine, coarse = (sum(tuft.area for tuft in row) for row in tufts)
    # mean of 280 coarse blades, whose lengths scatter by a quarter
    assert coarse == pytest.approx(fine, rel=0.1)
    assert len(tufts[1][0].faces) * 4 == len(tufts[0][0].faces)
