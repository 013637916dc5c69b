"""ROC, d′ and false alarms on evidence whose distributions are known."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.detection import (
    d_prime,
    motion_evidence,
    rightward_evidence,
    roc,
    roc_auc,
)

from ..textures import drifting_texture

SAMPLES = 20_000


def gaussians(distance, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=SAMPLES), rng.normal(distance, size=SAMPLES)


@pytest.mark.parametrize("distance", [0.0, 0.5, 1.0, 2.0, -1.0])
def test_two_gaussians_have_the_d_prime_of_their_distance(distance):
    # With 20 000 samples each the area is known to 1/√(6n) = 0.0029 at distance 0 and to 0.0014
    # (Hanley and McNeil 1982) at 2, d′ thereby to 0.010 and 0.014; five of them: below 6e-7.
    assert d_prime(*gaussians(distance)) == pytest.approx(distance, abs=5 * 0.014)


@pytest.mark.parametrize("distance", [0.5, 1.5])
def test_roc_of_two_gaussians_is_the_known_curve(distance):
    curve = roc(*gaussians(distance, seed=1))
    inside = (curve.false_alarms > 0.02) & (curve.false_alarms < 0.98)
    expected = norm.cdf(distance + norm.ppf(curve.false_alarms[inside]))
    # Hits and false alarms each stray by more than 2.9/√n with a probability of 1e-7 (Kolmogorov);
    # the slope of the curve, exp(d·z − d²/2), is at most 7.1 at z = 2.05, 2 % of false alarms.
    strays = (1 + 7.1) * 2.9 / math.sqrt(SAMPLES)
    np.testing.assert_allclose(curve.hits[inside], expected, atol=strays)


def test_area_is_the_integral_of_the_curve_ties_included():
    rng = np.random.default_rng(2)
    noise, signal = rng.poisson(3, 500), rng.poisson(4, 700)
    curve = roc(noise, signal)
    assert (curve.false_alarms[0], curve.hits[0]) == (0, 0)
    assert (curve.false_alarms[-1], curve.hits[-1]) == (1, 1)
    integral = np.trapezoid(curve.hits, curve.false_alarms)
    assert roc_auc(noise, signal) == pytest.approx(integral, abs=1e-12)
    pairs = noise[:, np.newaxis] - signal
    assert integral == pytest.approx(np.mean(pairs < 0) + 0.5 * np.mean(pairs == 0), abs=1e-12)


def test_separate_samples_give_the_limit_that_their_number_allows():
    noise, signal = np.zeros(256), np.ones(256)
    limit = math.sqrt(2) * norm.isf(0.5 / 256**2)
    assert d_prime(noise, signal) == pytest.approx(limit)
    assert d_prime(signal, noise) == pytest.approx(-limit)


@pytest.mark.parametrize("bad", [np.array([]), np.array([1.0, np.nan])])
def test_evidence_that_is_none_is_refused(bad):
    for call in (roc_auc, d_prime, roc):
        with pytest.raises(ValueError, match="at least one number, and no NaN"):
            call(bad, np.ones(3))


def settled(detector, velocity):
    """Responses to a drifting texture after the filters have settled."""
    frames = 2 + drifting_texture(velocity, detector.memory_frames + 4)
    return detector.respond(frames)[detector.memory_frames :]


@pytest.mark.parametrize("name", ["BM", "EMD", "NDM", "NDS", "DIS", "PM"])
def test_noise_free_motion_exceeds_standstill_in_nearly_all_blocks(name):
    detector = METHODS[name]
    moving, still = (
        motion_evidence(detector, settled(detector, velocity))
        for velocity in ((1.2, 0.0), (0.0, 0.0))
    )
    assert moving.shape[1:] == (8, 11) == still.shape[1:]
    assert roc_auc(still, moving) > 0.95


def test_evidence_of_a_block_is_the_mean_of_the_responses_in_it():
    responses = np.arange(2 * 30 * 40, dtype=float).reshape(2, 30, 40) - 700
    evidence = rightward_evidence(METHODS["EMD"], responses)
    assert evidence.shape == (2, 8, 11)
    assert evidence[1, 2, 3] == pytest.approx(responses[1, 9:12, 12:15].mean())
    np.testing.assert_array_equal(motion_evidence(METHODS["EMD"], responses), np.abs(evidence))
