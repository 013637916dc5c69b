"""What the kinds of a forest carry, how they are kept, and how they sway."""

from dataclasses import asdict

import numpy as np
import pytest

from megalopta.scenes.forest import specimens as nursery
from megalopta.scenes.forest.description import build_forest
from megalopta.scenes.forest.flora import BUSHES, LODS, PLANTS, TREES
from megalopta.scenes.forest.sway import FREQUENCY_SPREAD, FREQUENCY_TIMES_HEIGHT, Sway, Wind

from .test_description import TINY

LEAVES = [
    plant.coats["leaf"]
    for plant in PLANTS.values()
    if "leaf" in plant.coats and plant.name != "litter"
]


@pytest.mark.parametrize("coat", LEAVES)
def test_green_leaves_have_a_green_peak_and_a_red_edge_at_700_nm(coat):
    red_edge = np.arange(680, 801)
    for spectrum in (*coat.spectra, *coat.transmittances):
        green, red, near_infrared = spectrum([550, 670, 800])
        assert green > 2 * red and near_infrared > 1.9 * green and near_infrared > 5 * red
        half = (red + near_infrared) / 2
        assert 700 < np.interp(half, spectrum(red_edge), red_edge) < 740


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    nursery.texture.cache_clear()
    yield tmp_path / "megalopta" / "plants"
    nursery.texture.cache_clear()


def arrays(levels):
    """All arrays of organs at levels of detail, and what they are."""
    for level, organs in enumerate(levels):
        for organ, surface in organs.items():
            yield from ((f"{level} {organ} {key}", each) for key, each in asdict(surface).items())


@pytest.mark.parametrize("kind", ["hazel", "fern", "rock"])
def test_a_kept_plant_is_the_grown_one(kind, cache, monkeypatch):
    plant, levels = PLANTS[kind], LODS[:2]
    grown = nursery.grown(3, plant, 1, levels)
    (path,) = cache.iterdir()
    with monkeypatch.context() as patched:
        patched.setattr(nursery, "generator", lambda *_: pytest.fail("grown anew"))
        kept = nursery.grown(3, plant, 1, levels)
    path.write_bytes(path.read_bytes()[:100])  # damaged: grown anew
    for again in (kept, nursery.grown(3, plant, 1, levels)):
        np.testing.assert_equal(dict(arrays(again)), dict(arrays(grown)))


PATH = [[0.0, 0.0], [2.0, 0.0]]
TREE = Sway((3.0, 4.0, 1.0), 20.0, (0.0, 1.0), 0.3, 0.31, (0.4, 1.1))


@pytest.fixture(scope="module")
def windy():
    forest = TINY.model_copy(update={"wind": Wind(amplitude_m=0.4, seed=3)})
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
    assert moving == [each for each in windy.placements if each.kind in {*TREES, *BUSHES}]
    assert len({placement.motion.phases_rad for placement in moving}) == len(moving)
    for placement in moving:
        sway = placement.motion
        assert sway.amplitude_m == pytest.approx(0.4 * sway.height_m / 20)
        product = sway.frequency_hz * sway.height_m / FREQUENCY_TIMES_HEIGHT
        assert abs(product - 1) <= FREQUENCY_SPREAD
    tallest = max(placement.motion.height_m for placement in moving)
    assert 12 < tallest < 40
