import numpy as np
import pytest

from megalopta.flow.stimuli.statistics import (
    image_statistics,
    power_spectrum,
)

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
    assert image_statistics(fractal(exponent)).spectrum_slope == pytest.approx(exponent, abs=0.1)


def test_power_of_white_noise_is_its_relative_variance_at_every_frequency():
    template = 10 + np.random.default_rng(1).standard_normal(SHAPE)
    _, power = power_spectrum(template)
    # Rings hold 10 or more frequencies of relative scatter 1, averaged: 1/√(24 rings · 10) = 6 %.
    assert np.exp(np.log(power).mean()) == pytest.approx(0.01, rel=0.3)


def test_sinusoid_has_its_contrast_and_its_gradient():
    x = 2 * np.pi * 30 * np.arange(SHAPE[1]) / SHAPE[1]
    found = image_statistics(np.tile(1 + 0.6 * np.sin(x), (SHAPE[0], 1)))
    step = 2 * np.sin(np.pi * 30 / SHAPE[1])
    assert found.contrast == pytest.approx(0.6 / 2**0.5, rel=1e-9)
    assert found.gradient_contrast == pytest.approx(0.6 / 2**0.5 * step, rel=1e-9)
    assert found.gradient_kurtosis == pytest.approx(1.5, rel=1e-9)


def test_flat_share_is_the_part_without_texture():
    template = np.ones(SHAPE)
    template[:, :151] += np.resize([0.5, -0.5], 151)
    # Of 753 differences 152 are not: 150 within the textured part and one at either end of it.
    assert image_statistics(template).flat_share == pytest.approx(1 - 152 / 753, abs=1e-12)
