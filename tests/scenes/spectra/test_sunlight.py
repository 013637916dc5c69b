import numpy as np
import pytest

from megalopta.scenes.spectra.photometry import luminous
from megalopta.scenes.spectra.sunlight import ABOVE_ATMOSPHERE, CLEAR_SKY, SUN

BANDS = ((400, 700), (700, 900), (900, 1100), (1100, 1400), (1400, 1700))


def in_bands(spectrum):
    grids = [np.linspace(*band, 3001) for band in BANDS]
    return np.array([np.trapezoid(spectrum(grid), grid) for grid in grids])


@pytest.mark.parametrize(
    ("spectrum", "published"),
    [
        # W/m²: sums over the 2002 lines of ASTM G173-03, and over the 122 wavelengths of SPCTRL2
        (ABOVE_ATMOSPHERE, (530.0, 228.8, 148.5, 137.7, 81.48)),
        (SUN, (374.8, 191.2, 113.9, 82.69, 53.03)),
        (CLEAR_SKY, (56.54, 10.7, 4.119, 2.173, 0.9256)),
    ],
)
def test_table_keeps_the_light_of_its_source_in_bands(spectrum, published):
    # means over 20 nm, three digits; the sky's 1.4 µm band is coarse in the source, too
    np.testing.assert_allclose(in_bands(spectrum), published, rtol=0.02)


def test_direct_and_scattered_light_are_the_standards_hemispherical_light():
    # ASTM G173-03 on a plane tilted by 37°, 11.2° off the sun; what it sees of the ground is left
    # out: up to a third of what comes from the sky in the infrared, 5 % of the whole
    tilted = (429.8, 207.7, 120.9, 86.51, 54.55)
    seen = in_bands(SUN) * np.cos(np.radians(11.19)) + in_bands(CLEAR_SKY)
    np.testing.assert_allclose(seen, tilted, rtol=0.055)


def test_sun_has_the_efficacy_of_the_solar_constant():
    # 133 klux above the atmosphere, a textbook value, to its three digits
    assert luminous(ABOVE_ATMOSPHERE) == pytest.approx(133e3, rel=5e-3)
