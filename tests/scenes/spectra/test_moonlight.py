import numpy as np
import pytest

from megalopta.scenes.spectra.blackbody import planckian
from megalopta.scenes.spectra.moonlight import MOONLIGHT, SUN_K
from megalopta.scenes.spectra.photometry import luminous


def infrared_w_per_lux(spectrum):
    grid_nm = np.arange(800.0, 1701.0)
    return np.trapezoid(spectrum(grid_nm), grid_nm) / luminous(spectrum)


def test_disc_reddens_as_the_full_moon_of_kieffer_and_stone():
    # their model of the disc at a phase of 7°, over its value at 550 nm
    wavelengths_nm = np.array([441.6, 549.1, 665.1, 865.3, 1059.5, 1243.2, 1538.7, 1633.6])
    published = np.array([0.81, 1.00, 1.23, 1.38, 1.52, 1.62, 1.90, 1.92])
    reflectance = MOONLIGHT(wavelengths_nm) / planckian(SUN_K)(wavelengths_nm)
    # a straight line instead of their curve is off by up to 0.14
    np.testing.assert_allclose(reflectance / reflectance[1], published, atol=0.145)


def test_infrared_beside_200_mlux_is_closer_to_what_was_measured_than_a_planckian():
    measured = 600e-6 / 0.2  # at most, on the ground: Krieg 2021
    moon, usual = (infrared_w_per_lux(light) / measured for light in (MOONLIGHT, planckian(4100)))
    # the rest is the atmosphere's, which takes more of the infrared than of the green
    assert 1.0 < moon < 1.8
    assert usual == pytest.approx(2.7, abs=0.05)
