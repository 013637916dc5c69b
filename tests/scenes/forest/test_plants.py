"""What the kinds of a forest carry."""

import numpy as np
import pytest

from megalopta.scenes.forest.flora import BUSHES, TREES
from megalopta.scenes.forest.undergrowth import COVERS, PLANTS

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


@pytest.mark.parametrize("pair", PAIRS)
def test_reflectances_are_valid(pair):
    for spectrum in pair:
        assert 0 < spectrum(WAVELENGTHS_NM).min() <= spectrum(WAVELENGTHS_NM).max() < 1


def test_leaves_let_light_through_and_nothing_else_does():
    for name, plant in PLANTS.items():
        for organ, coat in plant.coats.items():
            green = organ == "leaf" and name != "litter"
            assert (coat.transmittances is not None) == green, (name, organ)
    assert not any(coat.transmittances for coat in COVERS.values())


@pytest.mark.parametrize("pair", [*GREEN, *THROUGH])
def test_green_leaves_have_a_green_peak_and_a_red_edge_at_700_nm(pair):
    red_edge = np.arange(680, 801)
    for spectrum in pair:
        green, red, near_infrared = spectrum([550, 670, 800])
        assert green > 2 * red and near_infrared > 1.9 * green and near_infrared > 5 * red
        half = (red + near_infrared) / 2
        assert 700 < np.interp(half, spectrum(red_edge), red_edge) < 740


def test_bark_soil_and_litter_brighten_toward_the_infrared():
    for pair in (*BARK, COVERS["litter"].spectra):
        for spectrum in pair:
            assert np.all(np.diff(spectrum(np.arange(380, 1001))) >= 0)
