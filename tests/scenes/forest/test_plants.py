"""What the kinds of a forest carry."""

import numpy as np
import pytest

from megalopta.scenes.forest.flora import BUSHES, COVERS, PLANTS, TREES

WAVELENGTHS_NM = np.arange(380, 1701)
WOODY = [*TREES.values(), *BUSHES.values()]
BARK = [plant.bark for plant in WOODY]
COATS = [coat for plant in PLANTS.values() for coat in plant.coats.values()]
PAIRS = [coat.spectra for coat in (*COATS, *COVERS.values())]
LEAVES = [
    plant.coats["leaf"]
    for plant in PLANTS.values()
    if "leaf" in plant.coats and plant.name != "litter"
]
GREEN = [coat.spectra for coat in LEAVES]
THROUGH = [coat.transmittances for coat in LEAVES]


def test_saplings_are_lower_and_thinner_than_their_trees():
    for name, sapling in BUSHES.items():
        if name.startswith("young "):
            small, tall = sapling.shape, TREES[name.removeprefix("young ")].shape
            assert small.height_m < tall.height_m / 3 and small.radius_m < tall.radius_m / 2
            assert small.bark == tall.bark


@pytest.mark.parametrize("pair", PAIRS)
def test_reflectances_are_valid(pair):
    for spectrum in pair:
        assert 0 < spectrum(WAVELENGTHS_NM).min() <= spectrum(WAVELENGTHS_NM).max() < 1


# The bark and the moss of a fallen log are alike at 1.29 µm.
@pytest.mark.parametrize(
    "pair",
    [
        coat.spectra
        for plant in PLANTS.values()
        if plant.name != "log"
        for coat in plant.coats.values()
        if coat.transmittances is None
    ],
)
def test_the_two_reflectances_of_a_coat_differ_in_every_band(pair):
    first, second = (spectrum(WAVELENGTHS_NM) for spectrum in pair)
    contrast = np.abs(first - second) / (first + second)
    assert contrast.min() > 0.1


def test_leaves_let_light_through_and_nothing_else_does():
    for name, plant in PLANTS.items():
        for organ, coat in plant.coats.items():
            green = organ == "leaf" and name != "litter"
            assert (coat.transmittances is not None) == green, (name, organ)
    assert not any(coat.transmittances for coat in COVERS.values())


@pytest.mark.parametrize("coat", LEAVES)
def test_the_light_end_of_a_leaf_is_brighter_on_both_sides_in_green(coat):
    for dark, light in (coat.spectra, coat.transmittances):
        assert light(550) > 1.15 * dark(550)


@pytest.mark.parametrize("pair", [*GREEN, *THROUGH])
def test_green_leaves_have_a_green_peak_and_a_red_edge_at_700_nm(pair):
    red_edge = np.arange(680, 801)
    for spectrum in pair:
        green, red, near_infrared = spectrum([550, 670, 800])
        assert green > 2 * red and near_infrared > 1.9 * green and near_infrared > 5 * red
        half = (red + near_infrared) / 2
        assert 700 < np.interp(half, spectrum(red_edge), red_edge) < 740


@pytest.mark.parametrize("pair", [*GREEN, *THROUGH])
def test_water_in_green_leaves_absorbs_at_1200_and_1450_nm(pair):
    for spectrum in pair:
        weak, strong = spectrum([1090, 1200, 1270]), spectrum([1270, 1450, 1660])
        assert weak[1] < 0.995 * (weak[0] + weak[2]) / 2
        assert strong[1] < 0.6 * strong[0] and strong[1] < 0.6 * strong[2]


def test_bark_soil_and_litter_brighten_toward_the_infrared():
    for pair in (*BARK, COVERS["litter"].spectra):
        for spectrum in pair:
            assert np.all(np.diff(spectrum(np.arange(380, 1001))) >= 0)
