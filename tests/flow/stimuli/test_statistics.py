import numpy as np
import pytest

from megalopta.flow.stimuli.statistics import fitted_slope, power_spectrum

SHAPE = (251, 753)


def fractal(exponent, seed=0):
    """Gaussian field of mean 10 whose power falls as frequency to the exponent."""
    noise = np.fft.rfft2(np.random.default_rng(seed).standard_normal(SHAPE))
    frequency = np.hypot(np.fft.fftfreq(SHAPE[0])[:, np.newaxis], np.fft.rfftfreq(SHAPE[1]))
    frequency[0, 0] = 1
    return 10 + np.fft.irfft2(noise * frequency ** (exponent / 2), SHAPE) / 10


@pytest.mark.parametrize("exponent", [0, -1, -2])
def test_slope_is_that_of_a_field_made_with_it(exponent):
    # 0.1 is 4 times the scatter over 20 seeds.
    assert fitted_slope(*power_spectrum(fractal(exponent))) == pytest.approx(exponent, abs=0.1)


def test_power_of_white_noise_is_its_relative_variance_at_every_frequency():
    template = 10 + np.random.default_rng(1).standard_normal(SHAPE)
    _, power = power_spectrum(template)
    # Rings hold 10 or more frequencies of relative scatter 1, averaged: 1/√(24 rings · 10) = 6 %.
    assert np.exp(np.log(power).mean()) == pytest.approx(0.01, rel=0.3)
