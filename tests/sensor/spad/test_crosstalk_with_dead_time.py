"""Crosstalk that meets dead time, against the plainest simulation and a law of two pixels."""

import numpy as np
import pytest

from megalopta.sensor.effects.crosstalk import Crosstalk
from megalopta.sensor.effects.dead_time import DeadTime
from megalopta.sensor.sampling.streams import generator
from megalopta.sensor.spad.counts import count_moments
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.simulation import simulate_frame
from megalopta.verification.physics import two_sample_z

TAU_S, EXPOSURE_S, RATE_HZ, EXPOSURES = 1e-6, 2e-5, 8e5, 1000


def effects(kind, fired, neighbors=4):
    dead_time = DeadTime(kind=kind, dead_time_s=TAU_S)
    talk = Crosstalk(mean_fired_neighbors=fired, diagonal=float(neighbors == 8))
    return AvalancheEffects(dead_time=dead_time, crosstalk=talk)


def plainly(rng, rates_hz, exposure_s, dead_time_s, is_extended, chance, neighbors):
    """Counts of one exposure: all photons of all pixels in order, each with all its light."""
    rows, columns = rates_hz.shape
    photons = sorted(
        (time, place)
        for place in np.ndindex(rows, columns)
        for time in rng.uniform(0, exposure_s, rng.poisson(rates_hz[place] * exposure_s))
    )
    counts, blind_until = np.zeros((rows, columns), int), np.zeros((rows, columns))
    for time, struck in photons:
        light = [struck]
        for row, column in light:
            is_live = time >= blind_until[row, column]
            if is_live or is_extended:
                blind_until[row, column] = time + dead_time_s
            if is_live:
                counts[row, column] += 1
                light += [
                    (row + down, column + right)
                    for down, right in neighbors
                    if 0 <= row + down < rows
                    and 0 <= column + right < columns
                    and rng.random() < chance
                ]
    return counts


STRAIGHT = ((-1, 0), (1, 0), (0, -1), (0, 1))
ALL = (*STRAIGHT, (-1, -1), (-1, 1), (1, -1), (1, 1))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nonparalyzable", "paralyzable"])
@pytest.mark.parametrize("neighbors", [STRAIGHT, ALL], ids=["4", "8"])
def test_counts_of_coupled_pixels_are_those_of_the_plainest_simulation(kind, neighbors):
    # uneven light on 3 × 3 pixels: a corner, an edge and the middle, and two pixels' covariance
    rates = RATE_HZ * np.linspace(0.5, 1.5, 9).reshape(3, 3)
    rng, other = generator(0, kind), generator(1, kind)
    parts = effects(kind, 0.6, len(neighbors))
    is_extended, chance = kind == "paralyzable", 0.6 / len(neighbors)
    ours = np.array(
        [simulate_frame(rng, rates, EXPOSURE_S, parts).counts for _ in range(EXPOSURES)]
    )
    plain = np.array(
        [
            plainly(other, rates, EXPOSURE_S, TAU_S, is_extended, chance, neighbors)
            for _ in range(EXPOSURES)
        ]
    )
    pairs = [each[:, 1, 1] + each[:, 1, 2] for each in (ours, plain)]
    for first, second in [
        pairs,
        *(
            (ours[:, row, column], plain[:, row, column])
            for row, column in ((0, 0), (0, 1), (1, 1))
        ),
    ]:
        # |z| < 6 of 8 numbers in each of 4 cases: a false alarm in 2e-9 · 32 < 1e-7
        mean_z, variance_z, _ = two_sample_z(first, second)
        assert abs(mean_z) < 6 and abs(variance_z) < 6


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
