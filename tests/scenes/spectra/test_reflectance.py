import numpy as np
import pytest

from megalopta.scenes.spectra import reflectance
from megalopta.scenes.spectra.spectrum import Spectrum

WAVELENGTHS_NM = np.arange(380, 1701)
NAMED = {name: s for name, s in vars(reflectance).items() if isinstance(s, Spectrum)}


@pytest.mark.parametrize("spectrum", NAMED.values(), ids=NAMED)
def test_reflectances_lie_between_zero_and_one(spectrum):
    assert spectrum(WAVELENGTHS_NM).min() > 0 and spectrum(WAVELENGTHS_NM).max() < 1


def test_dry_litter_shows_the_band_of_water_less_than_moist_soil():
    soil, litter = (s(1450) / s(1300) for s in (reflectance.SOIL, reflectance.LITTER))
    assert soil < 0.85 < litter < 1
