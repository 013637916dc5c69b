"""Crosstalk that meets dead time: a law of two pixels, and moments; `test_physics.py` has brute force."""

import numpy as np
import pytest

from megalopta.sensor.effects.crosstalk import Crosstalk
from megalopta.sensor.effects.dead_time import DeadTime
from megalopta.sensor.sampling.streams import generator
from megalopta.sensor.spad.counts import count_moments
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.simulation import simulate_frame

TAU_S, EXPOSURE_S, RATE_HZ = 1e-6, 2e-5, 8e5


def effects(kind, fired):
    dead_time = DeadTime(kind=kind, dead_time_s=TAU_S)
    return AvalancheEffects(dead_time=dead_time, crosstalk=Crosstalk(mean_fired_neighbors=fired))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nonparalyzable", "paralyzable"])
def test_dark_neighbor_of_a_bright_pixel_counts_its_share_of_the_avalanches(kind):
    # Avalanches of the bright one are a dead time apart, so the dark one is always live, and its
    # light meets the bright one at the instant of an avalanche: no change. Given N, Binomial(N, c).
    chance, rates = 0.15, np.array([[2 * RATE_HZ, 0.0]])
    rng, parts = generator(2, kind), effects(kind, 4 * chance)
    bright, dark = np.array(
        [simulate_frame(rng, rates, EXPOSURE_S, parts).counts[0] for _ in range(8000)]
    ).T
    expected, variance = chance * bright.sum(), chance * (1 - chance) * bright.sum()
    assert abs(dark.sum() - expected) < 5 * variance**0.5  # false alarm 6e-7
    alone = parts.without_crosstalk
    mean, spread = (part[0, 0] for part in count_moments(rates[:, :1], EXPOSURE_S, alone))
    assert abs(bright.mean() - mean) < 5 * (spread / bright.size) ** 0.5


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nonparalyzable", "paralyzable"])
@pytest.mark.parametrize(("saturation", "exposure_s"), [(0.001, 2e-3), (0.1, 1e-4), (1.0, 3e-5)])
def test_stated_moments_of_a_uniform_frame_are_those_of_simulated_ones(
    kind, saturation, exposure_s
):
    rates = np.full((64, 64), saturation / TAU_S)
    parts, inside = effects(kind, 0.3), np.s_[3:-3, 3:-3]
    frames = [
        simulate_frame(generator(i), rates, exposure_s, parts).counts[inside] for i in range(30)
    ]
    counts = np.array(frames, np.float64)
    mean, variance = (each[32, 32] for each in count_moments(rates, exposure_s, parts))
    # five standard errors (false alarm 6e-7), √1.6 times as large as neighbors share counts, and
    # the errors that `coupled` states
    error = 5 * 1.6**0.5 * counts.std() / counts.size**0.5
    assert counts.mean() == pytest.approx(mean, abs=error + 3e-3 * mean)
    assert counts.var() == pytest.approx(variance, rel=5 * 1.6 * (2 / counts.size) ** 0.5 + 6e-3)
