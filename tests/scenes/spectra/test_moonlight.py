import numpy as np
import pytest

from megalopta.scenes.spectra.photometry import luminous
from megalopta.scenes.spectra.sunlight import CLEAR_SKY, FULL_MOON, QUARTER_MOON, SUN, moonlit


def test_disc_reddens_as_the_full_moon_of_kieffer_and_stone():
    # their figure of the disc at a phase of 7°, over its value at 550 nm, with libration
    wavelengths_nm = np.array([441.6, 549.1, 665.1, 865.3, 1059.5, 1243.2, 1538.7, 1633.6])
    published = np.array([0.81, 1.00, 1.23, 1.38, 1.52, 1.62, 1.90, 1.92])
    np.testing.assert_allclose(FULL_MOON(wavelengths_nm), published, rtol=0.013)


def test_quarter_moon_is_redder():
    # 1.39 of its value at 550 nm per µm, the best line to 2 µm; the curve is off it by up to 12 %
    grid = np.linspace(450, 1650, 100)
    np.testing.assert_allclose(QUARTER_MOON(grid), 1 + 1.39 * (grid - 550) / 1000, rtol=0.12)


def test_infrared_beside_200_mlux_is_close_to_what_was_measured():
    grid_nm = np.arange(800.0, 1701.0)
    disc, sky = moonlit(SUN, FULL_MOON), moonlit(CLEAR_SKY, FULL_MOON)
    infrared = sum(
        share * np.trapezoid(light(grid_nm), grid_nm) / luminous(light)
        for share, light in ((0.8, disc), (0.2, sky))
    )
    # at most, on the ground: Krieg 2021; without air it is 1.75 times as much
    assert 1.0 < infrared / (600e-6 / 0.2) < 1.55


def test_moonlit_keeps_the_bands_of_water():
    moon = moonlit(SUN, FULL_MOON)
    assert moon(940) / moon(1000) == pytest.approx(SUN(940) / SUN(1000), rel=0.1)
