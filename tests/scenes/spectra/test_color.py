import numpy as np

from megalopta.scenes.spectra.color import (
    decode_srgb,
    encode_srgb,
    linear_srgb,
    matching_functions,
)
from megalopta.scenes.spectra.photometry import luminous_efficiency
from megalopta.scenes.spectra.spectrum import Spectrum, flat, planckian

BANDS = tuple((float(a), float(a + 50)) for a in range(400, 700, 50))


def band_means(spectrum):
    return np.array([spectrum(np.linspace(*band, 501)).mean() for band in BANDS])


def test_what_has_the_spectrum_of_the_light_is_neutral():
    light = planckian(9000)
    pixel = linear_srgb(band_means(light), BANDS, light)
    np.testing.assert_allclose(pixel, pixel.mean(), rtol=1e-4)


def test_a_green_leaf_is_green():
    leaf = Spectrum((400.0, 500.0, 550.0, 600.0, 680.0), (0.04, 0.05, 0.13, 0.07, 0.05))
    red, green, blue = linear_srgb(band_means(leaf), BANDS, flat(1.0))
    assert green > 1.2 * red > 0
    assert green > 1.3 * blue > 0


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


def test_decoded_srgb_is_coded_to_the_same_bytes():
    coded = np.arange(256, dtype=np.uint8)
    np.testing.assert_array_equal(encode_srgb(decode_srgb(coded)), coded)
