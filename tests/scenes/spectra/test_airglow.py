import numpy as np
import pytest

from megalopta.scenes.lighting.light import Light
from megalopta.scenes.spectra.night_sky import AIRGLOW, FAINT_STARLIGHT, MOONLESS_ZENITH

ARCSEC2_SR = (np.pi / 180 / 3600) ** 2
PHOTON_J_M = 1.98644586e-25


def magnitude(lower_nm, upper_nm, zero_point_w_m2_um):
    """Surface brightness, Vega magnitudes per square arcsecond."""
    grid = np.arange(lower_nm, upper_nm)
    radiance = np.trapezoid(MOONLESS_ZENITH(grid), grid) / (grid[-1] - grid[0])
    return -2.5 * np.log10(radiance * 1000 * ARCSEC2_SR / zero_point_w_m2_um)


def kilorayleigh(lower_nm, upper_nm):
    """Column emission, 1e9·4π photons per second, square meter and steradian of radiance."""
    grid = np.arange(lower_nm, upper_nm + 1)
    photons = MOONLESS_ZENITH(grid) * grid * 1e-9 / PHOTON_J_M
    return np.trapezoid(photons, grid) * 4 * np.pi / 1e13


def test_sky_has_the_measured_brightness_in_j_and_h():
    # edges of the bands lie in the middle of means over 20 nm; J has eight of them, and few lines
    assert magnitude(1510, 1790, 1.133e-9) == pytest.approx(14.4, abs=0.02)
    assert magnitude(1170, 1330, 3.129e-9) == pytest.approx(16.5, abs=0.08)


def test_oh_42_band_has_about_80_kilorayleigh():
    assert kilorayleigh(1570, 1660) == pytest.approx(80, rel=0.15)


def test_radiance_is_of_the_order_of_ten_nanowatts():
    grid = np.arange(1450, 1750)
    mean = np.mean(MOONLESS_ZENITH(grid)) * 1e8  # nW·cm⁻²·sr⁻¹·µm⁻¹
    assert 5 < mean < 15


def test_oxygen_stands_out_at_1270_nm():
    assert MOONLESS_ZENITH(1270.0) > 2 * max(MOONLESS_ZENITH(1230.0), MOONLESS_ZENITH(1310.0))


def test_table_covers_the_short_wave_infrared():
    assert MOONLESS_ZENITH.wavelengths_nm[0] <= 900
    assert MOONLESS_ZENITH.wavelengths_nm[-1] >= 1700


def test_sky_has_the_measured_brightness_in_the_visible():
    # Patat (2003) at the effective wavelengths; the zero points are those of Bessell et al. (1998)
    for wavelength_nm, magnitudes, zero_point in (
        (438, 22.6, 6.32e-8),
        (545, 21.6, 3.631e-8),
        (641, 20.9, 2.177e-8),
        (798, 19.7, 1.126e-8),
    ):
        radiance = MOONLESS_ZENITH(wavelength_nm) * 1000 * ARCSEC2_SR  # W·m⁻²·µm⁻¹·arcsec⁻²
        # three digits of the table
        assert -2.5 * np.log10(radiance / zero_point) == pytest.approx(magnitudes, abs=0.003)


def test_darkest_part_between_the_bands_is_near_the_measured_continuum():
    # Nguyen et al. (2016): 5330 nW·m⁻²·sr⁻¹ = λ·L at 1191.3 nm. A mean over 20 nm holds lines too.
    continuum = 5330e-9 / 1191.3
    assert 1 < MOONLESS_ZENITH(1190) / continuum < 2.5


def test_airglow_and_faint_starlight_are_the_zenith():
    grid = np.array(MOONLESS_ZENITH.wavelengths_nm)
    np.testing.assert_allclose(AIRGLOW(grid) + FAINT_STARLIGHT(grid), MOONLESS_ZENITH(grid))
    # Benn and Ellison (1998): 145 to 270 S10 in V, by the sun's activity; 27.78 mag·arcsec⁻² each
    s10 = 3.631e-8 * 10 ** (-0.4 * 27.78) / ARCSEC2_SR / 1000
    assert 145 < AIRGLOW(545) / s10 < 270


def test_level_airglow_is_this_sky():
    sky = Light(level="airglow").lighting()
    assert sky.sun is None
    grid = np.array(MOONLESS_ZENITH.wavelengths_nm)
    np.testing.assert_allclose(sky.sky(grid), MOONLESS_ZENITH(grid), rtol=1e-3)  # three digits
