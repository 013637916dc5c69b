import numpy as np
import pytest

from megalopta.assets_gen.grating import bars, random_dots


def test_a_sine_has_its_contrast_and_frequency_alone():
    x = np.arange(240) / 40
    spectrum = np.abs(np.fft.rfft(bars(x, 0.7, 0.4, square=False))) / 240
    assert spectrum[0] == pytest.approx(1, abs=1e-12)
    assert spectrum[6] == pytest.approx(0.35, abs=1e-12)
    assert np.delete(spectrum, [0, 6]).max() < 1e-12


def test_a_square_wave_has_the_odd_harmonics_of_its_fourier_series():
    texels = 4096
    x = (np.arange(texels) + 0.5) / texels
    amplitude = 2 * np.abs(np.fft.rfft(bars(x, 0.5, 0.0, square=True))) / texels
    orders = np.array([1, 3, 5, 7])
    # sampling at 4096 places changes low harmonics by less than (order/4096)²
    np.testing.assert_allclose(amplitude[orders], 0.5 * 4 / np.pi / orders, rtol=1e-4)
    assert amplitude[[2, 4, 6]].max() < 1e-12


@pytest.fixture(scope="module")
def dots():
    return random_dots((1536, 1536), (64.0, 64.0), 1.0, np.random.default_rng(3)) / 2


def test_random_dots_cover_half_of_the_plane(dots):
    # Integral of the Boolean model's covariance over lags is below 0.25·π·0.5² = 0.2 periods², so
    # the mean over 64² periods² scatters by less than 0.7 %; 5 sigma, false alarms below 6e-7.
    assert dots.mean() == pytest.approx(0.5, abs=0.035)


def test_random_dots_have_the_covariance_of_a_boolean_model(dots):
    power = np.abs(np.fft.fft2(dots)) ** 2
    both = np.fft.ifft2(power).real / dots.size
    uncovered = 1 - 2 * dots.mean() + both[0]
    radius, density = 0.25, np.log(2) / (np.pi * 0.25**2)
    lag = np.arange(0, 24) / 24
    half = np.clip(lag / (2 * radius), 0, 1)
    overlap = 2 * radius**2 * (np.arccos(half) - half * np.sqrt(1 - half**2))
    expected = np.exp(-density * (2 * np.pi * radius**2 - overlap))
    # same scatter as of the mean, twice; a texel is 1/24 period
    np.testing.assert_allclose(uncovered[:24], expected, atol=0.07)
    assert abs((uncovered[:24] - uncovered[20:24].mean() - expected + 0.25)[:12]).max() < 0.02
