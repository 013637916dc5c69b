"""Averaging of the true flow over blocks, and the errors against it."""

import math

import numpy as np
import pytest

from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.metrics.endpoint_error import (
    DenseErrors,
    ause,
    block_flow,
    sparsification,
    sparsified,
    truth_error,
    truth_splits,
)


def test_blocks_of_weighed_pixels_have_the_weighted_mean_and_lightweight_ones_none():
    rng = np.random.default_rng(6)
    flow, weights = rng.normal(size=(1, 40, 40, 2)), rng.random((1, 40, 40))
    weights[0, :10, :10] = 0.4
    grid = block_grid((40, 40), 10)
    averaged = block_flow(flow, grid, weights=weights)
    assert np.isnan(averaged[0, 0, 0]).all()  # a weight of 0.4 where half is asked
    weights[0, :10, :10] = 0.6
    averaged = block_flow(flow, grid, weights=weights)
    cut = flow.reshape(4, 10, 4, 10, 2), weights.reshape(4, 10, 4, 10, 1)
    expected = (cut[0] * cut[1]).sum(axis=(1, 3)) / cut[1].sum(axis=(1, 3))
    heavy = weights.reshape(4, 10, 4, 10).mean(axis=(1, 3)) >= 0.5
    assert heavy.sum() >= 4
    np.testing.assert_allclose(averaged[0][heavy], expected[heavy], rtol=1e-12)
    assert np.isnan(averaged[0][~heavy]).all()


def test_blocks_average_exactly_the_pixels_whose_centers_they_hold():
    rng = np.random.default_rng(1)
    flow, hidden = rng.normal(size=(1, 97, 83, 2)), rng.random((1, 97, 83)) < 0.2
    flow[rng.random((1, 97, 83)) < 0.1] = np.nan
    grid = block_grid((64, 50), 7)
    averaged = block_flow(flow, grid, hidden)
    for i, j in np.ndindex(grid.rows, grid.columns):
        inside = [
            flow[0, row, column]
            for row in range(97)
            for column in range(83)
            if 0 <= (row + 0.5) * 64 / 97 - grid.top - 7 * i < 7
            and 0 <= (column + 0.5) * 50 / 83 - grid.left - 7 * j < 7
            and not hidden[0, row, column]
        ]
        expected = np.nanmean(inside, axis=0) * (50 / 83, 64 / 97)
        np.testing.assert_allclose(averaged[0, i, j], expected, rtol=1e-9)


def test_bias_spread_and_outliers_are_those_of_the_differences():
    rng = np.random.default_rng(2)
    truth = np.tile((2.0, -1.0), (20, 12, 12, 1))
    difference = rng.normal((0.3, -0.2), (0.5, 0.1), truth.shape)
    error = truth_error(truth + difference, truth)
    inside = difference[:, 1:-1, 1:-1].reshape(-1, 2)
    lengths = np.hypot(*inside.T)
    assert error.bias_px == pytest.approx(tuple(inside.mean(axis=0)))
    assert error.spread_px == pytest.approx(tuple(inside.std(axis=0)))
    assert error.endpoint_error_median_px == pytest.approx(np.median(lengths))
    assert error.outlier_fraction == pytest.approx(np.mean(lengths > 0.25 * math.sqrt(5)))


def test_the_interval_of_the_median_covers_it():
    truth = np.tile((1.0, 0.0), (2, 9, 9, 1))
    covered = 0
    for seed in range(400):
        shifts = np.random.default_rng(seed).exponential(size=truth.shape) * (1.0, 0.0)
        low, high = truth_error(truth + shifts, truth).relative_error_interval
        covered += low <= math.log(2) <= high
    # of 98 blocks: 95.5 %; 6 σ below and above: a false alarm in 1e8 runs
    assert 0.955 - 0.062 < covered / 400 <= 1


def velocities(seed):
    rng = np.random.default_rng(seed)
    return rng.normal(scale=1.5, size=(4, 10, 12, 2))


def test_groups_share_all_blocks_and_all_errors():
    truth, answer = velocities(0), velocities(1)
    truth[2, 3, 4] = np.nan
    hidden = np.random.default_rng(2).random((4, 10, 12)).round()
    splits, whole = truth_splits(answer, truth, hidden), truth_error(answer, truth)
    for names in (("slow", "medium", "fast"), ("clear", "occlusion")):
        groups = [splits[name] for name in names]
        assert all(group.blocks > 0 for group in groups)
        assert sum(group.blocks for group in groups) == whole.blocks == 4 * 8 * 10 - 1
        total = sum(group.blocks * group.endpoint_error_px for group in groups)
        assert total == pytest.approx(whole.blocks * whole.endpoint_error_px)


RNG = np.random.default_rng(0)


def errors(flow, truth, occluded=None):
    found = DenseErrors()
    found.add(flow, truth, occluded)
    return found


def test_measures_of_one_pixel_are_those_of_their_definitions():
    """(3, 4) off at a motion of (30, 40): EPE 5, WAUC of i from 100 on only."""
    truth = np.full((1, 1, 2), (30.0, 40.0))
    found = errors(truth + np.array((3, 4)), truth).of("all")
    assert found.epe_px == 5
    shares = found.over_1px_percent, found.over_3px_percent, found.over_5px_percent
    assert shares == (100, 100, 0)
    assert found.fl_percent == 100  # 5 px are 10 % of 50 px
    assert found.wauc_percent == pytest.approx(100 * 0.01 / 50.5)
    a, b = np.array([33, 44, 1]), np.array([30, 40, 1])
    angle = np.degrees(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b)))
    assert errors(truth + np.array((2, 2)), truth).of("all").fl_percent == 0  # below 3 px
    assert np.isnan(errors(0 * truth, 0 * truth).of("fast").epe_px)
    assert found.angular_deg == pytest.approx(angle, rel=1e-6)


def test_wauc_is_the_weighted_sum_over_a_hundred_thresholds():
    truth = np.zeros((40, 50, 2))
    flow = RNG.normal(0, 2, truth.shape)
    epe = np.hypot(flow[..., 0], flow[..., 1])
    weights = 1 - np.arange(100) / 100
    inliers = np.array([(epe <= (i + 1) / 20).mean() for i in range(100)])
    expected = 100 * (weights * inliers).sum() / weights.sum()
    assert errors(flow, truth).of("all").wauc_percent == pytest.approx(expected, rel=1e-12)


def test_missing_answers_count_as_rest_and_are_told():
    truth = np.full((3, 2, 2), (2.0, 0.0))
    flow, truth[2] = truth.copy(), np.nan  # what has no truth is not scored
    flow[0, 0] = np.nan
    found = errors(flow, truth).of("all")
    assert (found.pixels, found.missing_percent, found.epe_px) == (4, 25, 0.5)


@pytest.mark.parametrize(
    ("flow", "hidden", "sentence"),
    [
        (np.zeros((3, 4, 2)), (4, 4), "shape|px"),
        (np.zeros((4, 4, 2)), (3, 4), "shape|px"),
        (np.zeros((4, 4)), (4, 4), "shape|px"),
        (np.full((4, 4, 2), np.nan), (4, 4), "no flow where the truth is known"),
    ],
)
def test_what_cannot_be_scored_is_refused(flow, hidden, sentence):
    with pytest.raises(ValueError, match=sentence):
        errors(flow, np.zeros((4, 4, 2)), np.zeros(hidden, bool))


def test_angular_error_is_measured_in_space_and_time():
    # (1, 0, 1) and (0, 1, 1) enclose 60°.
    error = truth_error(np.tile((1.0, 0.0), (1, 3, 3, 1)), np.tile((0.0, 1.0), (1, 3, 3, 1)))
    assert error.angular_error_deg == pytest.approx(60)
    assert error.endpoint_error_px == pytest.approx(math.sqrt(2))


def test_ause_has_closed_forms():
    rng = np.random.default_rng(5)
    errors = rng.exponential(size=(100, 400))
    perfect = ause(errors, 3 * errors**2)
    # the mean of the smallest 1 − x of the pixels is 1 + x·ln x/(1 − x): its area is 2 − π²/6
    assert perfect.ause == pytest.approx(0, abs=2e-3)  # bins of 3 %, squared of 6 %
    assert perfect.ause_random == pytest.approx(math.pi**2 / 6 - 1, abs=0.01)  # of 40,000 pixels
    constant = ause(errors, np.ones_like(errors))
    assert constant.ause == pytest.approx(constant.ause_random, rel=1e-12)
    assert constant.surest_half_px == pytest.approx(errors.mean())
    # half without error, half off by 2 px: ∫ max(0, ½ − x)/(½(1 − x)) dx = 1 − ln 2
    errors = np.repeat([0.0, 2.0], 500)
    assert ause(errors, errors).ause_random == pytest.approx(math.log(2), rel=1e-12)
    assert ause(errors, 2 - errors).ause == pytest.approx(2 * math.log(2), rel=1e-12)
    assert ause(errors, 1 + errors).surest_half_px == 0


def test_sparsification_is_that_of_an_independent_sort_of_all_images():
    rng, bins, parts = np.random.default_rng(6), 0, []
    for scale in (0.3, 4.0):
        errors = scale * rng.random((60, 80))
        uncertainty = errors * rng.lognormal(size=errors.shape)
        uncertainty[0, :3] = np.nan, np.inf, 1e300  # the least sure
        bins = bins + sparsification(errors, uncertainty)
        parts.append((errors.ravel(), np.where(uncertainty < 1e9, uncertainty, 1e9).ravel()))
    errors, uncertainty = np.concatenate(parts, axis=1)
    remaining = 1 + np.arange(errors.size)
    curves = [
        (np.cumsum(errors[np.argsort(key, kind="stable")]) / remaining / errors.mean()).mean()
        for key in (uncertainty, errors)
    ]
    assert sparsified(bins).ause == pytest.approx(curves[0] - curves[1], abs=2e-3)
    assert sparsified(bins).ause_random == pytest.approx(1 - curves[1], abs=2e-3)
    for wrong in (-uncertainty, uncertainty[1:]):
        with pytest.raises(ValueError, match="uncertainty"):
            ause(errors, wrong)
