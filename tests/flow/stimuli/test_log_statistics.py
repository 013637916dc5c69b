import numpy as np
import pytest
from scipy.stats import kurtosis, skew

from megalopta.flow.stimuli import PASSES, LogStatistics, log_statistics, unlit_share

from ..textures import drifting_texture


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


def test_noise_that_is_most_in_the_shade_adds_no_contrast():
    # a tenth of the light in the sun, half of it in the shade, whose logarithm is .14 too small
    rng = np.random.default_rng(2)
    logs = np.where(view(seed=3) > 0, 0.5, -0.5)
    shapes = np.where(logs > 0, 100, 4)
    passes = [np.exp(logs) * rng.gamma(shapes, 1 / shapes) for _ in range(PASSES)]
    single = [np.log(each).std() for each in passes]
    # Of two renderings in one value an eighth of that is left, (σ²/2)²: .01 of contrast .5.
    assert log_statistics(passes).contrast == pytest.approx(0.5, abs=0.015)
    assert min(single) > 0.6


def test_pixels_without_light_are_counted():
    light = np.ones((PASSES, 10, 10))
    light[0, :2] = 0
    assert unlit_share(light) == pytest.approx(0.2 / PASSES)


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
