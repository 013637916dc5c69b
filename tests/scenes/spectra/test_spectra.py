"""Spectra, the colors that they have, and reflectances."""

import math

import numpy as np
import pytest
from scipy.constants import sigma

from megalopta.scenes.levels import LEVELS
from megalopta.scenes.spectra.color import (
    LUMINANCE_SHARES,
    encode_srgb,
    linear_srgb,
    matching_functions,
    primaries,
)
from megalopta.scenes.spectra.reflectance import (
    LEAVES,
    REFLECTANCES,
    leaf_of,
    reflectance_of,
)
from megalopta.scenes.spectra.spectrum import (
    Spectrum,
    flat,
    luminous,
    luminous_efficiency,
    planckian,
)


def test_integral_of_luminous_efficiency_is_the_cie_value():
    grid = np.arange(360.0, 831.0)
    # 106.857 nm is the integral of the CIE's 1 nm table.
    assert np.trapezoid(luminous_efficiency(grid), grid) == pytest.approx(106.857, rel=1e-4)


def test_planckian_peaks_by_wiens_law_and_falls_like_stefan_boltzmann_predicts():
    spectrum = planckian(5000)
    peak = spectrum.wavelengths_nm[int(np.argmax(spectrum.values))]
    assert peak == pytest.approx(2.897771955e6 / 5000, abs=10)  # grid step
    # Tables of the black body: 0.9142 of the total lies below λT = 10 000 µm·K, 0.0128 below 1500.
    grid = np.linspace(300, 2000, 20001)
    scale = 2 * math.pi * 6.62607015e-34 * 299792458**2
    at_peak = scale / (peak * 1e-9) ** 5 / math.expm1(0.01438776877 / (peak * 1e-9 * 5000))
    total = np.trapezoid(spectrum(grid), grid) * 1e-9 * at_peak
    assert total / (sigma * 5000**4) == pytest.approx(0.9142 - 0.0128, abs=2e-3)


def test_spectrum_is_constant_beyond_its_ends_and_refuses_nonsense():
    spectrum = Spectrum((400.0, 500.0), (1.0, 3.0))
    np.testing.assert_allclose(spectrum([300, 450, 900]), [1, 2, 3])
    assert flat(0.3)(123.0) == 0.3
    for wavelengths in ((500.0, 400.0), (400.0, math.nan), (400.0, math.inf)):
        with pytest.raises(ValueError, match="must increase and be finite"):
            Spectrum(wavelengths, (1.0, 1.0))
    with pytest.raises(ValueError, match="non-negative"):
        Spectrum((400.0, 500.0), (1.0, -1.0))
    with pytest.raises(ValueError, match="one value per wavelength"):
        Spectrum((400.0, 500.0), (1.0,))


BANDS = tuple((float(a), float(a + 50)) for a in range(400, 700, 50))


def band_means(spectrum):
    return np.array([spectrum(np.linspace(*band, 501)).mean() for band in BANDS])


def test_what_has_the_spectrum_of_the_light_is_neutral():
    light = planckian(9000)
    pixel = linear_srgb(band_means(light), BANDS, light)
    np.testing.assert_allclose(pixel, pixel.mean(), rtol=1e-4)


def test_invisible_bands_show_as_gray():
    pixel = linear_srgb(np.array([[2.0, 4.0]]), ((900, 1000), (1000, 1100)), flat(1.0))
    np.testing.assert_allclose(pixel, 3.0)


def test_y_matching_function_is_the_luminous_efficiency():
    grid = np.arange(400.0, 701.0)
    # The Gaussian fit is good to about 1 % of the peak.
    error = matching_functions(grid)[:, 1] - luminous_efficiency(grid)
    assert np.abs(error).max() < 0.02


def test_srgb_curve_ends_at_black_and_white_and_is_monotonic():
    values = encode_srgb(np.linspace(-1, 2, 301)).astype(int)
    assert values[0] == 0
    assert values[-1] == 255
    assert (np.diff(values) >= 0).all()
    assert encode_srgb(np.array(0.2140)) == 127  # sRGB's middle gray


@pytest.mark.parametrize("level", LEVELS)
def test_primaries_add_up_to_the_light_and_share_its_luminance_as_srgb_does(level):
    light = LEVELS[level].spectrum()
    spectra = primaries(light)
    grid = np.array(spectra[0].wavelengths_nm)
    # On the primaries' own grid nothing is interpolated: float64 rounding is all that remains.
    np.testing.assert_allclose(sum(each(grid) for each in spectra), light(grid), rtol=1e-12)
    total = sum(map(luminous, spectra))
    np.testing.assert_allclose(
        [luminous(each) / total for each in spectra], LUMINANCE_SHARES, atol=1e-9
    )
    # Corners of the light's table between the grid's points.
    assert total == pytest.approx(LEVELS[level].illuminance_lux, rel=2e-3)


WAVELENGTHS_NM = np.arange(380, 1701)


@pytest.mark.parametrize("name", REFLECTANCES)
def test_reflectances_lie_between_zero_and_one(name):
    spectrum = reflectance_of(name)
    assert spectrum(WAVELENGTHS_NM).min() > 0 and spectrum(WAVELENGTHS_NM).max() < 1


def test_leaves_absorb_as_green_dry_and_young_ones_do():
    absorbed = {
        name: 1 - sum(spectrum([550, 670, 900]) for spectrum in leaf_of(name)) for name in LEAVES
    }
    for name in set(LEAVES) - {"dry leaf"}:
        green, red, infrared = absorbed[name]
        assert 0.35 < green < 0.85 and red > 0.8 and infrared < 0.2, name
    assert absorbed["young leaf light"][0] < absorbed["leaf light"][0] < absorbed["leaf dark"][0]
    assert absorbed["dry leaf"][1] < 0.3  # no chlorophyll
