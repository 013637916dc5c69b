"""The bound against closed forms, and against an estimator that should reach it."""

import numpy as np
import pytest

from megalopta.flow.detectors import block_grid
from megalopta.flow.metrics.translation_bound import (
    cramer_rao_covariance,
    cramer_rao_covariance_along_x,
    fisher_information,
    median_endpoint_error,
)

GRID = block_grid((72, 72), 24)
PERIOD = 24.0


def texture(dx=0.0, dy=0.0, mean=400.0):
    """Mean counts and their gradient of crossed waves displaced by (dx, dy), block (1, 1)."""
    y, x = np.mgrid[24:48, 24:48].astype(float)
    a, b = 2 * np.pi * (x - dx + y - dy) / PERIOD, 2 * np.pi * (x - dx - 2 * (y - dy)) / PERIOD
    slope = 2 * np.pi / PERIOD * mean
    value = mean * (1 + 0.3 * np.sin(a) + 0.5 * np.sin(b))
    along_x = slope * (0.3 * np.cos(a) + 0.5 * np.cos(b))
    along_y = slope * (0.3 * np.cos(a) - 1.0 * np.cos(b))
    return value, np.stack((along_x, along_y))


def test_information_of_a_sine_has_its_closed_form():
    # The mean of C²cos²/(1 + C·sin) over a period is 1 − √(1 − C²).
    contrast, mean = 0.8, 5.0
    wave = 1 + contrast * np.sin(2 * np.pi * np.arange(72) / PERIOD)
    information = fisher_information(mean * np.tile(wave, (72, 1)), GRID)[1, 1]
    per_pixel = mean * (2 * np.pi / PERIOD) ** 2 * (1 - np.sqrt(1 - contrast**2))
    # a cubic spline's slope is off by (2π/24)⁴/180 = 3e-5 of itself
    assert information[0, 0] == pytest.approx(24**2 * per_pixel, rel=1e-3)
    assert np.abs(information[[0, 1, 1], [1, 0, 1]]).max() < 1e-9 * information[0, 0]


@pytest.mark.slow
def test_maximum_likelihood_with_known_texture_reaches_the_bound():
    y, x = np.mgrid[:72, :72].astype(float)
    full = 400 * (
        1
        + 0.3 * np.sin(2 * np.pi * (x + y) / PERIOD)
        + 0.5 * np.sin(2 * np.pi * (x - 2 * y) / PERIOD)
    )
    bound = cramer_rao_covariance(fisher_information(full, GRID)[1, 1])
    rng = np.random.default_rng(5)
    draws = 800
    places = np.zeros((draws, 2, 2))
    for place in places.reshape(-1, 2):
        counts = rng.poisson(texture()[0])
        for _ in range(3):  # Fisher scoring; the third step is below 1e-6 px
            value, slope = texture(*place)
            score = -(slope * (counts / value - 1)).sum(axis=(1, 2))
            place += np.linalg.solve(np.einsum("iyx,jyx->ij", slope, slope / value), score)
    velocities = places[:, 1] - places[:, 0]
    measured = np.cov(velocities.T)
    # A variance from 800 draws is off by √(2/800) = 5 %: 5.5 of those. A bound of one noisy
    # frame would be off by a factor of 2.
    np.testing.assert_allclose(np.diag(measured), np.diag(bound), rtol=0.275)
    correlation = bound[0, 1] / np.sqrt(bound[0, 0] * bound[1, 1])
    assert measured[0, 1] / np.sqrt(measured[0, 0] * measured[1, 1]) == pytest.approx(
        correlation, abs=0.2
    )


@pytest.mark.parametrize("frames", [2, 3, 8])
def test_more_frames_tell_a_velocity_as_a_line_through_their_displacements(frames):
    information = np.array([[3.0, 1.0], [1.0, 2.0]])
    design = np.vander(np.arange(frames), 2)
    slope_variance = np.linalg.inv(design.T @ design)[0, 0]
    np.testing.assert_allclose(
        cramer_rao_covariance(information, frames), slope_variance * np.linalg.inv(information)
    )


def test_knowing_that_nothing_moves_along_y_lowers_the_bound_along_x():
    information = np.array([[3.0, 1.0], [1.0, 2.0]])
    assert cramer_rao_covariance_along_x(information)[0, 0] == pytest.approx(2 / 3)
    assert (
        cramer_rao_covariance_along_x(information)[0, 0] < cramer_rao_covariance(information)[0, 0]
    )


def test_stripes_have_no_bound_and_darkness_no_information():
    stripes = np.tile(1 + 0.5 * np.sin(np.arange(72) / 3), (72, 1))
    assert np.all(np.isinf(cramer_rao_covariance(fisher_information(stripes, GRID))))
    assert np.all(fisher_information(np.zeros((72, 72)), GRID) == 0)


def test_median_length_of_normal_errors_has_its_closed_forms():
    assert median_endpoint_error(np.eye(2) * 9) == pytest.approx(3 * np.sqrt(2 * np.log(2)))
    # along a line it is 0.6745 σ; 64 directions give that within 1 %
    assert median_endpoint_error(np.diag([4.0, 0.0])) == pytest.approx(2 * 0.6745, rel=0.01)


def test_median_length_pools_blocks_as_draws_of_all_of_them_do():
    roots = (
        np.random.default_rng(2).normal(size=(5, 2, 2))
        * np.array([0.1, 0.5, 1, 2, 5])[:, np.newaxis, np.newaxis]
    )
    draws = np.random.default_rng(3).normal(size=(200_000, 5, 2))
    lengths = np.linalg.norm(np.einsum("kij,nkj->nki", roots, draws), axis=-1)
    # the median of 1e6 lengths: 0.5/√1e6 in probability, five of those are below 1 % in length
    assert median_endpoint_error(roots @ roots.transpose(0, 2, 1)) == pytest.approx(
        np.median(lengths), rel=0.01
    )


def test_half_of_the_blocks_without_bound_leave_no_median():
    both = np.stack((np.eye(2), np.full((2, 2), np.inf)))
    assert median_endpoint_error(both) == np.inf


def test_negative_means_are_refused():
    with pytest.raises(ValueError, match="negative or non-finite"):
        fisher_information(np.full((72, 72), -1.0), GRID)
