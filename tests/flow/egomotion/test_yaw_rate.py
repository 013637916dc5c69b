"""The camera's yaw rate, learned in the first half of a sequence and tried on the second."""

import numpy as np
import pytest

from megalopta.flow import METHODS
from megalopta.flow.egomotion.wide_field import YawRateTest, fit_wide_field, yaw_rates_deg_s
from megalopta.scenes import Trajectory


def answers(frames, noise, seed):
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


@pytest.mark.parametrize("rate", [0.0, 3.0])
def test_no_rotation_or_no_answer_gives_no_error(rate):
    nothing = np.zeros((10, 5, 5, 2))
    assert tried(METHODS["LK"], nothing, nothing, np.full(10, rate), 1, 10) is None


def test_methods_that_are_blind_to_direction_take_no_part():
    ideal, rates = answers(40, 0.1, seed=0)
    assert tried(METHODS["NDM"], ideal, ideal, rates, 3, 8) is None


@pytest.mark.parametrize("chunk", [1, 7, 40, 64])
def test_the_error_is_that_of_a_filter_fitted_to_the_first_half_however_the_sequence_is_cut(chunk):
    (ideal, rates), (noisy, _) = answers(41, 0.2, seed=1), answers(41, 0.5, seed=1)
    found = tried(METHODS["EMD"], ideal, noisy, rates, 4, chunk)
    # The response after the first frame belongs to the first rate; four of the rates settle.
    learned, half = slice(5, 23), 22
    field = fit_wide_field(ideal[learned], rates[4:half])
    for error, responses in ((found.ideal_deg_s, ideal), (found.counts_deg_s, noisy)):
        expected = np.sqrt(np.mean((field.rates(responses[half + 1 :]) - rates[half:]) ** 2))
        assert error == pytest.approx(expected, rel=1e-9)
    assert found.true_deg_s == pytest.approx(np.sqrt(np.mean(rates[half:] ** 2)))
