import numpy as np
import pytest

from megalopta.assets_gen.plants.flora import BUSHES, TREES
from megalopta.scenes.spectra import reflectance
from megalopta.scenes.spectra.spectrum import Spectrum

WAVELENGTHS_NM = np.arange(380, 1701)
NAMED = {name: s for name, s in vars(reflectance).items() if isinstance(s, Spectrum)}
PAIRS = [*reflectance.BARK.values(), *reflectance.LEAF.values(), *reflectance.GROUND.values()]
GREEN = [pair for kind, pair in reflectance.LEAF.items() if kind != "litter"]


@pytest.mark.parametrize("spectrum", NAMED.values(), ids=NAMED)
def test_reflectances_lie_between_zero_and_one(spectrum):
    assert spectrum(WAVELENGTHS_NM).min() > 0 and spectrum(WAVELENGTHS_NM).max() < 1


@pytest.mark.parametrize("pair", PAIRS)
def test_the_two_reflectances_of_a_texture_are_valid_and_differ_in_every_band(pair):
    first, second = (spectrum(WAVELENGTHS_NM) for spectrum in pair)
    assert min(first.min(), second.min()) > 0 and max(first.max(), second.max()) < 1
    contrast = np.abs(first - second) / (first + second)
    assert contrast.min() > 0.1


@pytest.mark.parametrize("pair", GREEN)
def test_green_leaves_have_a_green_peak_and_a_red_edge_at_700_nm(pair):
    red_edge = np.arange(680, 801)
    for spectrum in pair:
        green, red, near_infrared = spectrum([550, 670, 800])
        assert green > 2 * red and near_infrared > 5 * red
        half = (red + near_infrared) / 2
        assert 700 < np.interp(half, spectrum(red_edge), red_edge) < 740
        assert spectrum(690) < half < spectrum(750)


@pytest.mark.parametrize("pair", GREEN)
def test_water_in_green_leaves_absorbs_at_1200_and_1450_nm(pair):
    for spectrum in pair:
        weak, strong = spectrum([1090, 1200, 1270]), spectrum([1270, 1450, 1660])
        assert 0.8 < weak[1] / weak[0] < weak[1] / weak[2] < 1
        assert strong[1] < 0.5 * strong[0] and strong[1] < 0.55 * strong[2]


def test_bark_soil_and_litter_brighten_toward_the_infrared():
    for pair in (*reflectance.BARK.values(), reflectance.GROUND["litter"]):
        for spectrum in pair:
            assert np.all(np.diff(spectrum(np.arange(380, 1001))) >= 0)


def test_dry_litter_shows_the_band_of_water_less_than_moist_soil():
    soil, litter = (spectrum(1450) / spectrum(1300) for spectrum in reflectance.GROUND["litter"])
    assert soil < 0.85 < litter < 1


def test_every_woody_kind_has_bark_and_leaves():
    assert reflectance.BARK.keys() == {**TREES, **BUSHES}.keys()
    assert reflectance.BARK.keys() <= reflectance.LEAF.keys()
