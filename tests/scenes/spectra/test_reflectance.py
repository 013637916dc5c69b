import numpy as np
import pytest

from megalopta.scenes.spectra.reflectance import REFLECTANCES, reflectance_of

WAVELENGTHS_NM = np.arange(380, 1701)


@pytest.mark.parametrize("name", REFLECTANCES)
def test_reflectances_lie_between_zero_and_one(name):
    spectrum = reflectance_of(name)
    assert spectrum(WAVELENGTHS_NM).min() > 0 and spectrum(WAVELENGTHS_NM).max() < 1


def test_dry_litter_shows_the_band_of_water_less_than_moist_soil():
    soil, litter = (s(1450) / s(1300) for s in map(reflectance_of, ("soil", "litter")))
    assert soil < 0.85 < litter < 1
