"""The checks that users run, as tests, and that they notice a wrong model.

Rows are compared at |z| < 5: a right program fails one with probability 6e-7, with fixed streams
always or never.
"""

import numpy as np
import pytest

from megalopta.sensor import check_counting
from megalopta.sensor.check import exact_row, law_z, mean_row, total_variation, two_sample_z
from megalopta.sensor.check_counting import counting_checks, effects_of, operating_point, samples
from megalopta.sensor.check_terms import TERM_CHECKS
from megalopta.sensor.randomness import generator

COUNTING = counting_checks(arrivals=1e5)


@pytest.mark.parametrize("check", TERM_CHECKS, ids=lambda check: check.__name__)
def test_effects_agree_with_their_closed_forms(check):
    assert [row for row in check() if not row.passed] == []


@pytest.mark.parametrize("check", COUNTING, ids=lambda check: check.args[0])
def test_counts_agree_with_brute_force_in_mean_variance_and_law(check):
    assert [row for row in check() if not row.passed] == []


@pytest.mark.parametrize("kind", ["nonparalyzable", "paralyzable"])
@pytest.mark.parametrize("start", ["live", "stationary"])
def test_total_variation_distance_to_brute_force_is_that_of_chance(kind, start):
    effects = effects_of(kind, start, check_counting.AFTERPULSING)
    rate, exposure = operating_point(kind, 0.1, 30)
    plain, drawn = samples(effects, rate, exposure, 100_000)
    share = np.bincount(plain) / plain.size
    chance = np.sqrt(share * (1 - share) / (np.pi * plain.size)).sum()
    # mean of the distance by the normal approximation, excess by McDiarmid's with probability 1e-6
    assert total_variation(plain, drawn) < chance + np.sqrt(14 / plain.size)


def test_a_dead_time_one_percent_too_long_is_noticed():
    right = effects_of("nonparalyzable", "live", check_counting.AFTERPULSING)
    longer = right.dead_time.model_copy(update={"dead_time_s": 1.01e-6})
    plain, _ = samples(right, 1e6, 60e-6, 100_000)
    _, wrong = samples(right._replace(dead_time=longer), 1e6, 60e-6, 100_000)
    assert abs(two_sample_z(plain, wrong)[0]) > 5


def test_laws_that_share_mean_and_variance_are_told_apart():
    rng = generator(0)
    poisson = rng.poisson(9.0, 50_000)
    normal = np.rint(rng.normal(9.0, np.sqrt(9 - 1 / 12), 50_000)).clip(0).astype(int)
    assert law_z(poisson, rng.poisson(9.0, 50_000)) < 5 < law_z(poisson, normal)


def test_constant_samples_pass_only_where_they_are_right():
    assert mean_row("x", "y", 2.0, np.full(10, 2)).passed
    assert not mean_row("x", "y", 2.0, np.full(10, 3)).passed
    assert not exact_row("x", "y", 1.0, 1.1, 0.05).passed
