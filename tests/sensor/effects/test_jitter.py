"""Time stamps against the moments of their distribution."""

import numpy as np
from scipy.stats import exponnorm, kstest, norm

from megalopta.sensor import Jitter
from megalopta.sensor.effects.timing import stamp

SIGMA_S, SHARE, TAIL_S, EVENTS = 50e-12, 0.2, 300e-12, 200_000
JITTER = Jitter(sigma_s=SIGMA_S, tail_share=SHARE, tail_s=TAIL_S)


def test_stamps_are_a_mixture_of_a_normal_and_an_exponentially_modified_normal():
    late = stamp(np.random.default_rng(2), np.zeros(EVENTS), JITTER) / SIGMA_S
    tailed = exponnorm(TAIL_S / SIGMA_S)

    def mixture(x):
        return (1 - SHARE) * norm.cdf(x) + SHARE * tailed.cdf(x)

    assert kstest(late, mixture).pvalue > 1e-6  # false alarm 1e-6


def test_without_a_tail_stamps_are_as_before():
    times = np.linspace(0, 1, 5)
    plain = Jitter(sigma_s=1e-3)
    expected = times + 1e-3 * np.random.default_rng(3).standard_normal(5)
    np.testing.assert_array_equal(stamp(np.random.default_rng(3), times, plain), expected)


def test_records_without_a_tail_are_as_before_there_was_one():
    assert Jitter(sigma_s=1e-3).model_dump() == {"sigma_s": 1e-3}
    assert Jitter.model_validate(JITTER.model_dump()) == JITTER
