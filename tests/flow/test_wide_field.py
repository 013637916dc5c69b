"""Rotation and heading from answers of detectors."""

import numpy as np
import pytest

from megalopta.flow import METHODS
from megalopta.flow.wide_field import YawRateTest, fit_wide_field, yaw_rates_deg_s
from megalopta.scenes import Trajectory


def known_answers(seed, rates, slopes, noise):
    rng = np.random.default_rng(seed)
    return slopes * rates[:, np.newaxis] + noise * rng.normal(size=(len(rates), slopes.size))


def test_spread_is_that_of_the_matched_filter():
    rng = np.random.default_rng(5)
    slopes, noise = rng.normal(size=200), np.full(200, 2.0)
    learned, rates = rng.normal(size=4000), rng.normal(size=4000)
    field = fit_wide_field(known_answers(1, learned, slopes, noise), learned)
    error = field.rates(known_answers(2, rates, slopes, noise)) - rates
    expected = 1 / np.sqrt(np.sum((slopes / noise) ** 2))
    # A standard deviation of 4000 is known to 1.1 %; five of them, and 1 % for the fitted slopes.
    assert error.std() == pytest.approx(expected, rel=0.065)
    assert field.standard_error == pytest.approx(expected, rel=0.065)
    assert abs(error.mean()) < 5 * expected / np.sqrt(4000) + 5 * expected / np.sqrt(4000)


@pytest.mark.parametrize(("places", "frames", "seeds"), [(2000, 40, 8), (5000, 100, 8)])
def test_many_weak_places_do_not_draw_the_rate_to_zero(places, frames, seeds):
    # All slopes together have a hundred times less power than their noise in one frame. A filter
    # that takes the squares of noisy slopes would find 0.3 and 0.2 of the rate. The ratio of the
    # found rate to the true one has a standard deviation of 0.09 and 0.03 for one seed; the first
    # is 0.06 too small, as a mean of quotients. Five standard deviations of the mean and that.
    ratios = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        slopes, noise = rng.normal(0, 0.1, places), np.ones(places)
        learned, rates = rng.normal(size=frames), rng.normal(size=400)
        field = fit_wide_field(known_answers(seed + 100, learned, slopes, noise), learned)
        found = field.rates(known_answers(seed + 200, rates, slopes, noise))
        ratios.append(found @ rates / (rates @ rates))
    assert np.mean(ratios) == pytest.approx(1, abs=0.23)


def test_undefined_answers_leave_the_rate_right():
    rng = np.random.default_rng(7)
    slopes, rates = rng.normal(size=30), rng.normal(size=25)
    exact = rates[:, np.newaxis] * slopes
    gaps = np.where(rng.random(exact.shape) < 0.5, np.nan, exact)
    gaps[:, 0] = np.nan
    gaps[3] = np.nan
    field = fit_wide_field(gaps, rates)
    found = field.rates(gaps)
    assert np.isnan(found[3])
    assert field.weights[0] == 0
    np.testing.assert_allclose(np.delete(found, 3), np.delete(rates, 3), rtol=1e-12)


@pytest.mark.parametrize(
    ("answers_shape", "rates", "words"),
    [
        ((4, 2), np.ones(3), "give one each"),
        ((4, 2), np.zeros(4), "rates other than 0"),
        ((4, 2), np.ones(4), "no response depends on the rate"),
    ],
)
def test_what_cannot_be_learned_from_is_refused(answers_shape, rates, words):
    with pytest.raises(ValueError, match=words):
        fit_wide_field(np.zeros(answers_shape), rates)


def yaw_rate_answers(frames, noise, seed):
    """Responses of 5 × 6 pixels with slopes of their own, and the rates that they belong to."""
    rng = np.random.default_rng(seed)
    rates, slopes = rng.normal(3, 1, frames - 1), rng.normal(size=(5, 6))
    responses = np.concatenate((np.full((1, 5, 6), 1e3), rates[:, None, None] * slopes))
    return responses + noise * rng.normal(size=responses.shape), rates


def tried(detector, ideal, noisy, rates, warm_up, chunk):
    trial = YawRateTest(detector, rates, warm_up)
    for first in range(0, len(ideal), chunk):
        trial.add(ideal[first : first + chunk], noisy[first : first + chunk])
    return trial.result()


def test_yaw_rate_of_a_path_is_positive_to_the_right():
    # A trajectory counts its turns to the left.
    rates = yaw_rates_deg_s(Trajectory(frames=5, frame_rate_hz=20, rotation_deg_s=30))
    np.testing.assert_allclose(rates, [-30] * 4, rtol=1e-9)


def test_methods_that_are_blind_to_direction_take_no_part():
    ideal, rates = yaw_rate_answers(40, 0.1, seed=0)
    assert tried(METHODS["NDM"], ideal, ideal, rates, 3, 8) is None


@pytest.mark.parametrize("chunk", [1, 7, 40, 64])
def test_the_error_is_that_of_a_filter_fitted_to_the_first_half_however_the_sequence_is_cut(chunk):
    (ideal, rates), (noisy, _) = (
        yaw_rate_answers(41, 0.2, seed=1),
        yaw_rate_answers(41, 0.5, seed=1),
    )
    found = tried(METHODS["EMD"], ideal, noisy, rates, 4, chunk)
    # The response after the first frame belongs to the first rate; four of the rates settle.
    learned, half = slice(5, 23), 22
    field = fit_wide_field(ideal[learned], rates[4:half])
    for error, responses in ((found.ideal_deg_s, ideal), (found.counts_deg_s, noisy)):
        expected = np.sqrt(np.mean((field.rates(responses[half + 1 :]) - rates[half:]) ** 2))
        assert error == pytest.approx(expected, rel=1e-9)
    assert found.true_deg_s == pytest.approx(np.sqrt(np.mean(rates[half:] ** 2)))
