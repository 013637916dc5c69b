import math

import numpy as np
import pytest

from megalopta.scenes.levels import LEVELS, illuminance_of
from megalopta.scenes.spectra.spectrum import luminous

from .published import (
    ARCSEC2_SR,
    BANDS,
    FULL_MOON,
    FULL_MOON_NM,
    SKY,
    SUN,
    in_bands,
    quarter_moon,
)

LUX = {
    "daylight": 1e5,
    "twilight": 1.0,
    "full_moon": 0.25,
    "quarter_moon": 1e-2,
    "starlight": 1e-3,
    "airglow": 8.19e-4,
    "moonless_forest_floor": math.pi * 1e-4,  # 1e-4 cd/m² of white: Kelber et al. 2006
    "overcast_night": 1e-4,
}
SUN_LUX, SKY_LUX = 97.13e3, 12.67e3
# By the middle of a band's light; over the mean that the eye sees
MIDDLES = np.array((545, 795, 1010, 1225, 1570))
FULL, QUARTER = np.interp(MIDDLES, FULL_MOON_NM, FULL_MOON), quarter_moon(MIDDLES)

# Patat et al. (2006), the zenith with the sun 6.4° below the horizon, at B, V, R and I over V, with
# the zero points of Bessell et al.
MAGNITUDES = np.array((13.735, 13.853, 13.469, 12.866))
TWILIT_ZENITH = np.array((6.32, 3.631, 2.177, 1.126)) / 3.631 * 10 ** (-0.4 * (MAGNITUDES - 13.853))


def irradiance(level):
    return in_bands(LEVELS[level].spectrum())


def published(light, lux, reflectance=1.0):
    """W/m² in the bands, as bright as the eye sees 1 lux, of a published spectrum and its lux."""
    return light * reflectance / lux


def night(level):
    """Published radiance of the moonless sky at B, V, R, I and H, W·m⁻²·sr⁻¹·nm⁻¹, and the level's."""
    photometry = (  # Patat (2003) and Cuby et al. (2000), zero points of Bessell et al. and Cohen
        ((438, 438), 22.6, 6.32e-8),
        ((545, 545), 21.6, 3.631e-8),
        ((641, 641), 20.9, 2.177e-8),
        ((798, 798), 19.7, 1.126e-8),
        ((1510, 1790), 14.4, 1.133e-9),
    )
    sky = [zero / 1000 * 10 ** (-0.4 * each) / ARCSEC2_SR for _, each, zero in photometry]
    spectrum = LEVELS[level].spectrum()
    seen = [spectrum(np.linspace(*band, 2801)).mean() / math.pi for band, _, _ in photometry]
    return np.array(sky), np.array(seen)


@pytest.mark.parametrize("level", LEVELS)
def test_components_add_up_to_the_named_illuminance(level):
    lux = sum(each.illuminance_lux for each in LEVELS[level].components)
    assert lux == pytest.approx(LUX[level], rel=0.02)
    assert lux == pytest.approx(luminous(LEVELS[level].spectrum()), rel=1e-9)
    assert lux == pytest.approx(illuminance_of(level), rel=1e-9)


def test_daylight_is_the_published_sun_and_sky_in_five_bands():
    expected = 0.8e5 * published(SUN, SUN_LUX) + 0.2e5 * published(SKY, SKY_LUX)
    np.testing.assert_allclose(irradiance("daylight"), expected, rtol=0.05)


@pytest.mark.parametrize(
    ("level", "lux", "disc"), [("full_moon", 0.25, FULL), ("quarter_moon", 0.01, QUARTER)]
)
def test_moonlit_nights_are_the_published_moon_and_night_sky_in_five_bands(level, lux, disc):
    moon = lux - 1e-3
    expected = 0.8 * moon * published(SUN, SUN_LUX, disc / disc[0])
    expected += 0.2 * moon * published(SKY, SKY_LUX, disc / disc[0])
    expected += irradiance("starlight")  # which has a test of its own
    np.testing.assert_allclose(irradiance(level), expected, rtol=0.05)


def test_dark_sky_is_the_published_one_in_five_bands():
    sky, seen = night("airglow")
    np.testing.assert_allclose(seen, sky, rtol=0.05)


def test_starry_sky_is_the_dark_one_and_what_else_there_is_of_starlight():
    sky, seen = night("starlight")
    # 201 S10 at V for all of the sky, of which 75 are in the dark one; less what the air takes, and
    # a fifth that the named illuminance leaves out
    s10 = 3.631e-11 * 10 ** (-0.4 * 27.78) / ARCSEC2_SR
    more = (201 * 0.87 * 0.8 - 75) * s10 * np.array((0.9, 1.0, 1.0, 0.8, 0.25))
    np.testing.assert_allclose(seen, sky + more, rtol=0.05)


def test_twilight_is_the_published_zenith_in_four_bands():
    # Patat et al. (2006) with the sun 6.4° below the horizon, at B, V, R and I, over that at V
    spectrum = LEVELS["twilight"].spectrum()
    seen = spectrum(np.array((438.0, 545, 641, 798))) / spectrum(545.0)
    np.testing.assert_allclose(seen, TWILIT_ZENITH, rtol=0.05)


def test_twilight_beyond_i_is_scattered_sunlight_and_the_night_sky():
    # Scattered by air: from the band of I on as sunlight on the ground, air mass 1.5, times λ⁻⁴ at
    # the middles of the bands' light. Means over bands, since water vapor cuts into all of them. To
    # that comes the night sky of the level: 2, 15 and 70 % of all light there.
    ground = (SUN / 1.5 + SKY) / np.ptp(BANDS, axis=1)
    scattered = (ground * MIDDLES**-4.0)[2:] / (ground * MIDDLES**-4.0)[1]
    in_i = TWILIT_ZENITH[3] * LEVELS["twilight"].spectrum()(545.0)
    night = irradiance("starlight")[2:]
    expected = in_i * scattered * np.ptp(BANDS, axis=1)[2:] + night
    np.testing.assert_allclose(irradiance("twilight")[2:], expected, rtol=0.05)


def test_an_overcast_night_is_a_dark_night_less_its_infrared():
    clear, overcast = (irradiance(each) for each in ("starlight", "overcast_night"))
    ratio = overcast / clear / 0.1
    assert ratio[0] == pytest.approx(1, abs=0.02)
    assert (np.diff(ratio) <= 1e-3).all() and 0.4 < ratio[-1] < 0.7


def test_levels_are_named_or_given_in_lux():
    assert illuminance_of("starlight") == 1e-3
    assert illuminance_of(0.3) == 0.3
    with pytest.raises(ValueError, match="'dusk' is unknown: use one of daylight"):
        illuminance_of("dusk")
    with pytest.raises(ValueError, match="lux: give between 1e-12 and 1e.09 lux"):
        illuminance_of(-1.0)
