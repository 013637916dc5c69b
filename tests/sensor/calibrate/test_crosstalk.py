"""Crosstalk and afterpulses of dark counts against the crosstalk that made them."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import spearmanr

from megalopta.camera.measurements import read_measurement
from megalopta.sensor import Crosstalk, DarkCounts
from megalopta.sensor.calibrate.crosstalk import (
    PairCrosstalk,
    crosstalk_of_hot_pixels,
    fit_crosstalk,
    kernel_of,
    modelled,
    neighbor_kernel,
)
from megalopta.sensor.calibrate.statistics import both, statistics
from megalopta.sensor.effects import crosstalk
from megalopta.sensor.effects.crosstalk import neighborhoods
from megalopta.sensor.effects.dark_counts import dark_count_density

LIGHT = Crosstalk(mean_fired_neighbors=0.03, diagonal=0.2, distance_two=0.02)
OWN = dark_count_density(
    DarkCounts(
        bulk_mean_hz_um2=1.0,
        bulk_sigma_hz_um2=0.4,
        hot_fraction=0.2,
        hot_mean_hz_um2=50,
        hot_sigma_hz_um2=200,
    ),
    (96, 128),
    device_seed=1,
)
RATES = crosstalk.mean(OWN, LIGHT)


def test_shares_are_the_probabilities_that_neighbors_fire():
    found = crosstalk_of_hot_pixels(RATES).mean(axis=(0, 1))
    # edges have 6e-3; the scatter of ordinary pixels leaves errors of 1e-4 for each of 48 places
    assert np.allclose(found, neighborhoods(LIGHT)[0, 0], atol=6e-4)


def test_without_crosstalk_neighbors_are_independent():
    assert not kernel_of(crosstalk_of_hot_pixels(OWN))[0].is_on
    found = kernel_of(crosstalk_of_hot_pixels(RATES))[0]
    own = RATES - crosstalk.fired_mean(RATES, found)
    correlation, left = (
        spearmanr(rates[:, :-1].ravel(), rates[:, 1:].ravel())[0] for rates in (RATES, own)
    )
    assert correlation > 0.2
    # 5 standard errors of a rank correlation, 1/√n
    assert abs(left) < 5 / np.sqrt(RATES.size)


def test_pairs_of_rows_are_recognized():
    pairs = np.zeros((2, 1, 3, 3))
    pairs[0, 0, 2, 1] = pairs[1, 0, 0, 1] = 3.0  # rows 0 and 1, 2 and 3, …
    pairs[:, :, 1, [0, 2]] = 1.0
    made = Crosstalk(mean_fired_neighbors=0.03, kernel=pairs.tolist())
    found = kernel_of(crosstalk_of_hot_pixels(crosstalk.mean(OWN, made)))[0]
    by_row = neighborhoods(found)[:, :, 2:5, 2:5].mean(axis=1)
    # half of the pixels, errors of 2e-4
    assert np.allclose(by_row, neighborhoods(made)[:, 0], atol=1e-3)


@pytest.mark.parametrize(("probability", "carriers"), [(0.0, 0.0), (0.1, 0.0), (0.0, 0.1)])
def test_crosstalk_and_afterpulses_of_dark_counts(probability, carriers):
    rng = np.random.default_rng(3)
    effect = Crosstalk(mean_fired_neighbors=probability)
    generation = rng.poisson(10.0, (1500, 16, 16))
    counts = np.zeros_like(generation)
    while generation.any():
        counts += np.array([crosstalk.spread(rng, frame, effect) for frame in generation])
        generation = rng.poisson(carriers * generation)
    kernel = neighbor_kernel(statistics(counts), np.ones((16, 16), bool))
    # orthogonal shares a quarter each; edges see less, which is below the error; 5 standard errors
    truth = np.array([probability / 4] * 2 + [0.0] * 4)[:, None, None]
    assert np.all(np.abs(kernel.share - truth) < 5 * kernel.error + 0.03 * probability / 4)
    assert kernel.is_seen == (probability > 0)
    assert abs(kernel.afterpulses - carriers) < 5 * kernel.afterpulses_error + 0.002
    assert kernel.are_afterpulses_seen == (carriers > 0)


def fired_by(kernel, means, frames):
    """Counts of primaries of these means and of those that they fire, by parity of the row."""
    rng = np.random.default_rng(4)
    counts = generation = rng.poisson(means, (frames, *means.shape))
    while generation.any():
        fired = np.zeros_like(generation)
        for parity, down, right in np.argwhere(kernel > 0):
            sent = np.zeros_like(generation)
            sent[:, parity::2] = generation[:, parity::2]
            sent = rng.binomial(sent, kernel[parity, down, right])
            to, by = both((down - 1, right - 1)) if down else both((1, 1 - right))[::-1]
            fired[:, *by] += sent[:, *to]
        generation = fired
        counts = counts + generation
    return counts


@pytest.mark.slow
def test_pairs_of_rows_are_seen_by_coincidences_of_lognormal_dark_counts():
    means = np.exp(0.6 * np.random.default_rng(5).standard_normal((64, 64)))
    made = np.zeros((2, 3, 3))
    made[0, 2, 1] = made[1, 0, 1] = 0.02  # rows 0 and 1, 2 and 3, …
    made[:, 1, [0, 2]] = 0.005
    counts = fired_by(made, means, 300)
    kernel = neighbor_kernel(statistics(counts), np.ones((64, 64), bool))
    truth = np.zeros((6, 2, 2))
    truth[0], truth[1, 0] = 0.005, 0.02
    # 24 values, 5.5 standard errors: a false alarm in 1e6
    assert np.all(np.abs(kernel.share - truth) < 5.5 * kernel.error)
    found = neighborhoods(kernel.crosstalk)[:, 0, 1:4, 1:4]
    assert np.abs(found[0, 2, 1] - 0.02) < 5 * kernel.error.max() / np.sqrt(2)
    assert found[0, 0, 1] < 5 * kernel.error.max() / np.sqrt(2)
    assert abs(kernel.seen[0].mean_fired_neighbors - 0.03) < 5 * kernel.total_error
    # alike in every direction: one probability, and none written by parity
    alike = np.where(np.hypot(*(np.indices((3, 3)) - 1)) == 1, 0.01, 0.0)
    counts = fired_by(np.tile(alike, (2, 1, 1)), means, 300)
    kernel = neighbor_kernel(statistics(counts), np.ones((64, 64), bool))
    assert kernel.is_seen and not kernel.crosstalk.kernel
    dark = neighbor_kernel(
        statistics(np.random.default_rng(6).poisson(means, (300, 64, 64))), np.ones((64, 64), bool)
    )
    assert not dark.is_seen and 0 < dark.limit < 2e-3


PAIRS = Crosstalk(mean_fired_neighbors=0.05, diagonal=0.3, distance_two=0.05, distance_three=0.01)


def test_crosstalk_of_bits_is_that_of_the_events_that_make_them():
    rng, share = np.random.default_rng(4), np.array([0.01, 0.01, 0, 0, 0, 0])
    events = rng.poisson(0.4 * rng.lognormal(0, 0.6, (40, 40)), (2000, 40, 40))
    bits = events > 0
    bits[:, 1:] |= rng.binomial(events[:, :-1], 0.01) > 0
    bits[:, :-1] |= rng.binomial(events[:, 1:], 0.01) > 0
    bits[:, :, 1:] |= rng.binomial(events[:, :, :-1], 0.01) > 0
    bits[:, :, :-1] |= rng.binomial(events[:, :, 1:], 0.01) > 0
    kernel = neighbor_kernel(statistics(bits), np.ones((40, 40), np.bool_), is_binary=True)
    # 24 parities of offsets, 5.5 σ: 1e-6
    assert np.all(np.abs(kernel.share - share[:, None, None]) < 5.5 * kernel.error)
    assert kernel.is_seen and not kernel.are_afterpulses_seen
    assert kernel.error[:2].max() < 1.5e-3


def test_pairs_return_the_crosstalk_that_made_them():
    down, right = (each.ravel() for each in np.indices((4, 6)))
    zeros = np.zeros(down.size)
    pairs = PairCrosstalk(down, right, zeros, zeros, zeros)
    found = fit_crosstalk(pairs._replace(probability=modelled(PAIRS, pairs)))
    for name in ("mean_fired_neighbors", "diagonal", "distance_two", "distance_three"):
        assert getattr(found, name) == pytest.approx(getattr(PAIRS, name), rel=1e-12)


def test_what_shows_no_crosstalk_is_refused():
    with pytest.raises(ValueError, match="48 pixels; crosstalk of hot pixels needs 4096"):
        crosstalk_of_hot_pixels(np.ones((4, 12)))
    pair = PairCrosstalk(*(np.array([2]),) * 2, *(np.array([1.0]),) * 3)
    with pytest.raises(ValueError, match="give pairs at a distance of 1"):
        fit_crosstalk(pair)


@pytest.mark.parametrize(("array", "edge"), [(1, 1.03e-3), (2, 9.2e-4)])
def test_crosstalk_of_edge_neighbors_is_the_published_one(array, edge):
    arrays = Path(__file__).parents[3] / "docs/public_arrays"
    found = fit_crosstalk(read_measurement(arrays / f"crosstalk-{array}.csv"))
    shares = 1 + found.diagonal + found.distance_two + found.distance_three
    # the paper gives two digits
    assert found.mean_fired_neighbors / (4 * shares) == pytest.approx(edge, rel=0.01)
