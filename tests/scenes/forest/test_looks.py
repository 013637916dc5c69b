import runpy
from pathlib import Path

import numpy as np
import pytest

LOOKS = runpy.run_path(str(Path(__file__).parents[3] / "benchmarks/bench_looks.py"))
fitted_slope, ring_means = LOOKS["fitted_slope"], LOOKS["ring_means"]

SHAPE = (251, 753)


def fractal(exponent, seed=0):
    """Power of a Gaussian field that falls as frequency to the exponent."""
    noise = np.fft.rfft2(np.random.default_rng(seed).standard_normal(SHAPE))
    frequency = np.hypot(np.fft.fftfreq(SHAPE[0])[:, np.newaxis], np.fft.rfftfreq(SHAPE[1]))
    frequency[0, 0] = 1
    return np.abs(noise * frequency ** (exponent / 2)) ** 2 / np.prod(SHAPE)


@pytest.mark.parametrize("exponent", [0, -1, -2])
def test_slope_is_that_of_a_field_made_with_it(exponent):
    # 0.1 is 4 times the scatter over 20 seeds.
    assert fitted_slope(*ring_means(fractal(exponent), 753)) == pytest.approx(exponent, abs=0.1)


def test_power_of_white_noise_is_its_variance_at_every_frequency():
    _, power = ring_means(fractal(0), SHAPE[1])
    # Rings hold 10 or more frequencies of relative scatter 1, averaged: 1/√(24 rings · 10) = 6 %.
    assert np.exp(np.log(power).mean()) == pytest.approx(1, rel=0.3)
