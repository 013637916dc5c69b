"""Light of the sky and of what shines in it, against published figures."""

import math

import numpy as np
import pytest

from megalopta.scenes.spectra import outdoors
from megalopta.scenes.spectra.spectrum import luminous

from .. import published
from ..published import ARCSEC2_SR, in_bands

PHOTON_J_M = 1.98644586e-25


def magnitude(lower_nm, upper_nm, zero_point_w_m2_um):
    """Surface brightness, Vega magnitudes per square arcsecond."""
    grid = np.arange(lower_nm, upper_nm)
    radiance = np.trapezoid(outdoors.MOONLESS_ZENITH(grid), grid) / (grid[-1] - grid[0])
    return -2.5 * np.log10(radiance * 1000 * ARCSEC2_SR / zero_point_w_m2_um)


def test_sky_has_the_measured_brightness_in_j_and_h():
    # edges of the bands lie in the middle of means over 20 nm; J has eight of them, and few lines
    assert magnitude(1510, 1790, 1.133e-9) == pytest.approx(14.4, abs=0.02)
    assert magnitude(1170, 1330, 3.129e-9) == pytest.approx(16.5, abs=0.08)
    # Column emission of the OH (4–2) band: 80 kR, 1e13/4π photons per second, m² and steradian.
    grid = np.arange(1570, 1661)
    photons = outdoors.MOONLESS_ZENITH(grid) * grid * 1e-9 / PHOTON_J_M
    assert np.trapezoid(photons, grid) * 4 * np.pi / 1e13 == pytest.approx(80, rel=0.15)


def test_airglow_and_faint_starlight_are_the_zenith():
    grid = np.array(outdoors.MOONLESS_ZENITH.wavelengths_nm)
    np.testing.assert_allclose(
        outdoors.AIRGLOW(grid) + outdoors.FAINT_STARLIGHT(grid), outdoors.MOONLESS_ZENITH(grid)
    )
    # Benn and Ellison (1998): 145 to 270 S10 in V, by the sun's activity; 27.78 mag·arcsec⁻² each
    s10 = 3.631e-8 * 10 ** (-0.4 * 27.78) / ARCSEC2_SR / 1000
    assert 145 < outdoors.AIRGLOW(545) / s10 < 270


def test_disc_reddens_as_the_full_moon_of_kieffer_and_stone():
    np.testing.assert_allclose(
        outdoors.FULL_MOON(published.FULL_MOON_NM), published.FULL_MOON, rtol=0.013
    )
    # At a quarter the curve is off the best line by up to 12 %.
    grid = np.linspace(450, 1650, 100)
    np.testing.assert_allclose(outdoors.QUARTER_MOON(grid), published.quarter_moon(grid), rtol=0.12)


def two_streams(single_scattering_albedo, thickness, asymmetry, layers=3000):
    """Share let through by a layer, added up of thin ones (two diffuse streams)."""
    step = thickness / layers
    back = np.sqrt(3) / 2 * single_scattering_albedo * (1 - asymmetry) * step
    lost = np.sqrt(3) * (1 - single_scattering_albedo) * step
    through, reflected = 1.0, 0.0
    for _ in range(layers):
        multiple = 1 / (1 - reflected * back)
        through, reflected = (
            through * multiple * (1 - back - lost),
            back + (1 - back - lost) ** 2 * reflected * multiple,
        )
    return through


@pytest.mark.parametrize(("wavelength_nm", "absorption_cm"), [(1600.0, 6.7), (1200.0, 1.04)])
def test_color_is_that_of_a_layer_added_up_of_thin_ones(wavelength_nm, absorption_cm):
    absorbed = 0.85 * 100 * absorption_cm * 8e-6
    clear, wet = (two_streams(1 - each, 30.0, 0.86) for each in (0.0, absorbed))
    # thin layers of a hundredth of the thickness at which light turns back
    assert outdoors.OVERCAST(wavelength_nm) == pytest.approx(wet / clear, rel=0.01)
    assert outdoors.OVERCAST(np.arange(380, 780)).min() > 0.99  # gray to the eye


@pytest.mark.parametrize(
    ("spectra", "lux", "rel"),
    [
        ([outdoors.ABOVE_ATMOSPHERE], 133e3, 5e-3),  # a textbook value, to its three digits
        ([outdoors.TWILIGHT.scaled(math.pi)], 1.0, 0.1),
        # The usual value for a starry sky; parts from five papers, each good to some 20 %.
        ([outdoors.STARLIGHT.scaled(math.pi), outdoors.AIRGLOW.scaled(math.pi)], 1e-3, 0.15),
    ],
)
def test_light_has_its_known_illuminance(spectra, lux, rel):
    assert sum(map(luminous, spectra)) == pytest.approx(lux, rel=rel)


def test_zodiacal_light_is_the_mean_of_its_latitudes():
    # Benn and Ellison (1998) over the sphere
    latitude = np.radians(np.linspace(0, 90, 9001))
    brightness = np.where(latitude < np.pi / 3, 140 - 90 * np.sin(latitude), 60)
    mean = np.trapezoid(brightness * np.cos(latitude), latitude)
    assert mean == pytest.approx(outdoors.ZODIACAL_S10, rel=0.01)


@pytest.mark.parametrize(
    ("spectrum", "in_source"),
    [
        # W/m²: sums over the 2002 lines of ASTM G173-03, and over the 122 wavelengths of SPCTRL2
        (outdoors.ABOVE_ATMOSPHERE, (530.0, 228.8, 148.5, 137.7, 81.48)),
        (outdoors.SUN, published.SUN),
        (outdoors.CLEAR_SKY, published.SKY),
    ],
)
def test_table_keeps_the_light_of_its_source_in_bands(spectrum, in_source):
    # means over 20 nm, three digits; the sky's 1.4 µm band is coarse in the source, too
    np.testing.assert_allclose(in_bands(spectrum), in_source, rtol=0.02)


def test_direct_and_scattered_light_are_the_standards_hemispherical_light():
    # ASTM G173-03 on a plane tilted by 37°, 11.2° off the sun; what it sees of the ground is left
    # out: up to a third of what comes from the sky in the infrared, 5 % of the whole
    tilted = (429.8, 207.7, 120.9, 86.51, 54.55)
    seen = in_bands(outdoors.SUN) * np.cos(np.radians(11.19)) + in_bands(outdoors.CLEAR_SKY)
    np.testing.assert_allclose(seen, tilted, rtol=0.055)


@pytest.mark.parametrize(("band", "depression_deg"), [((1170, 1330), 9.3), ((1510, 1790), 7.4)])
def test_night_begins_in_the_infrared_when_it_was_seen_to(band, depression_deg):
    """It falls by a factor of four per degree; 1 to 20 % of airglow are when one sees night."""
    grid = np.arange(*band)
    now = outdoors.TWILIGHT(grid).mean() / outdoors.AIRGLOW(grid).mean()
    assert 0.01 < now * 4 ** -(depression_deg - 6.4) < 0.2
