"""Both errors against direct sums."""

import numpy as np
import pytest

from megalopta.flow.detectors.block_matching import BlockMatching
from megalopta.flow.detectors.correlation import ElementaryMotionDetector
from megalopta.flow.detectors.image_interpolation import ImageInterpolation
from megalopta.flow.metrics.response_error import (
    METRICS,
    error_of,
    error_parts,
    error_sums,
    quotient,
)

PIXELS = ElementaryMotionDetector()
BLOCKS = BlockMatching()


def responses(seed, shape=(5, 20, 30)):
    return np.random.default_rng(seed).normal(size=shape)


def per_frame(sums, metric):
    return quotient(*error_parts(sums, metric))


@pytest.mark.parametrize("metric", METRICS)
def test_errors_are_equation_4_5_and_the_quotient_of_the_sums(metric):
    ideal, noisy = responses(0)[:, 1:-1, 1:-1], responses(1)[:, 1:-1, 1:-1]
    size = np.abs(ideal) if metric == "ratio" else np.ones(ideal.shape)
    off = np.abs(ideal - noisy) * size / np.abs(ideal)
    sums = error_sums(PIXELS, responses(0), responses(1))
    expected = off.sum(axis=(1, 2)) / size.sum(axis=(1, 2))
    np.testing.assert_allclose(per_frame(sums, metric), expected, rtol=1e-12)
    assert error_of(sums, metric) == pytest.approx(off.sum() / size.sum(), rel=1e-12)


def test_a_zero_ideal_response_is_floored_in_literal_and_harmless_in_ratio():
    ideal = np.ones((1, 4, 3))
    noisy = ideal + 0.5
    ideal[0, 1, 1] = 0
    sums = error_sums(PIXELS, ideal, noisy)
    assert error_of(sums, "literal") == pytest.approx(1.5e20 / 2)
    assert error_of(sums, "ratio") == pytest.approx(2)


def test_a_frame_without_any_ideal_response_has_no_error():
    ideal = np.stack([np.zeros((4, 4)), np.ones((4, 4))])
    sums = error_sums(PIXELS, ideal, ideal + 0.5)
    np.testing.assert_array_equal(per_frame(sums, "literal"), (np.nan, 0.5))
    assert error_of(sums, "literal") == 0.5
    assert np.isnan(error_of(error_sums(PIXELS, ideal[:1], ideal[1:]), "literal"))


def test_velocity_error_is_the_length_of_the_difference():
    ideal = np.tile((3.0, 4.0), (2, 5, 5, 1))
    noisy = np.tile((3.0, 1.0), (2, 5, 5, 1))
    assert error_of(error_sums(BLOCKS, ideal, noisy), "literal") == pytest.approx(3 / 5)
    first_component = error_sums(ImageInterpolation(), ideal, noisy)
    assert error_of(first_component, "literal") == 0


def test_blocks_at_rest_are_not_scored():
    ideal, noisy = np.zeros((1, 5, 5, 2)), np.ones((1, 5, 5, 2))
    ideal[0, 2, 2] = noisy[0, 2, 2] = (2, 0)
    sums = error_sums(BLOCKS, ideal, noisy)
    assert sums[3].sum() == 1
    assert error_of(sums, "literal") == 0


def test_a_missing_velocity_counts_as_the_answer_zero():
    ideal = np.tile((2.0, 0.0), (1, 5, 5, 1))
    missing = error_sums(BLOCKS, ideal, np.full_like(ideal, np.nan))
    zero = error_sums(BLOCKS, ideal, np.zeros_like(ideal))
    assert error_of(missing, "literal") == error_of(zero, "literal") == 1
    assert error_of(missing, "ratio") == error_of(zero, "ratio") == 1
