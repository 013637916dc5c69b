import numpy as np
import pytest
from scipy.stats import kurtosis, skew

from megalopta.flow.stimuli.statistics import (
    PASSES,
    LogStatistics,
    image_statistics,
    log_statistics,
    power_spectrum,
)

from ..textures import drifting_texture

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


def view(seed=0):
    """Logarithm of light: skewed, heavy-tailed, with a power spectrum that falls."""
    texture = drifting_texture((0, 0), 1, (240, 260), blur_px=1.5, seed=seed)[0]
    unit = texture / texture.std()
    return 0.7 * unit + 0.15 * unit**2 + 0.02 * unit**3


def fields(statistics):
    return np.array(list(vars(statistics).values()))


def test_of_a_picture_they_are_the_plain_moments():
    logs = view()
    found = log_statistics([np.exp(logs)] * PASSES)
    steps = np.diff(logs, axis=1)
    assert found.contrast == pytest.approx(logs.std(), rel=1e-9)
    assert found.skewness == pytest.approx(skew(logs, axis=None), rel=1e-9)
    assert found.kurtosis == pytest.approx(kurtosis(logs, axis=None, fisher=False), rel=1e-9)
    assert found.gradient_contrast == pytest.approx(np.sqrt(np.mean(steps**2)), rel=1e-9)
    # about the mean difference, which is not taken off
    assert found.gradient_kurtosis == pytest.approx(
        kurtosis(steps, axis=None, fisher=False), rel=1e-3
    )
    # of all neighbors with one mean, Pearson's of two halves with their own
    pearson = np.corrcoef(logs[:, :-1].ravel(), logs[:, 1:].ravel())[0, 1]
    assert found.neighbor_correlation == pytest.approx(pearson, abs=1e-4)


def test_noise_of_renderings_takes_no_part():
    # noise of a third of the light, distributed as means of a few paths are, takes the correlation
    # of neighbors in a single picture from .89 to .75
    logs, rng = view(), np.random.default_rng(1)
    passes = [np.exp(logs) * rng.gamma(9, 1 / 9, logs.shape) for _ in range(PASSES)]
    clean, found = log_statistics([np.exp(logs)] * PASSES), log_statistics(passes)
    single = log_statistics([passes[0]] * PASSES)
    # the noise of 60 000 pixels leaves 1 % of second moments and 5 % of fourth ones
    np.testing.assert_allclose(fields(found), fields(clean), rtol=0.08)
    assert single.neighbor_correlation < clean.neighbor_correlation - 0.04
    assert single.spectrum_slope > clean.spectrum_slope + 0.15
    assert abs(found.neighbor_correlation - clean.neighbor_correlation) < 0.003


def test_white_noise_has_no_slope_and_no_correlation():
    logs = np.random.default_rng(0).normal(size=(300, 300))
    found = log_statistics([np.exp(logs)] * PASSES)
    # a moment of 90 000 pixels is right to a few hundredths, a slope, of rings of few waves, to .1
    expected = LogStatistics(1, 0, 3, 2**0.5, 3, 0, 0)
    np.testing.assert_allclose(fields(found), fields(expected), atol=0.3)


@pytest.mark.parametrize(
    ("passes", "sentence"),
    [
        (np.ones((3, 8, 8)), "give 8"),
        (-np.ones((8, 8, 8)), "0 or more"),
        (np.full((8, 8, 8), np.nan), "0 or more"),
        (np.zeros((8, 8, 8)), "black"),
    ],
)
def test_what_is_no_light_is_refused(passes, sentence):
    with pytest.raises(ValueError, match=sentence):
        log_statistics(passes)
