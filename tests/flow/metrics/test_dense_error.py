import numpy as np
import pytest

from megalopta.flow.metrics.endpoint_error import GROUPS, DenseErrors

RNG = np.random.default_rng(0)


def errors(flow, truth, occluded=None):
    found = DenseErrors()
    found.add(flow, truth, occluded)
    return found


def test_measures_of_one_pixel_are_those_of_their_definitions():
    """(3, 4) off at a motion of (30, 40): EPE 5, WAUC of i from 100 on only."""
    truth = np.full((1, 1, 2), (30.0, 40.0))
    found = errors(truth + np.array((3, 4)), truth).of("all")
    assert (found.epe_px, found.epe_rms_px, found.epe_of_images_px) == (5, 5, 5)
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


def test_groups_share_the_pixels_by_sight_and_by_speed():
    truth = RNG.uniform(-60, 60, (30, 20, 2))
    hidden = RNG.random((30, 20)) < 0.3
    found = errors(truth + RNG.normal(size=truth.shape), truth, hidden)
    counted = {name: found.of(name).pixels for name in GROUPS}
    assert counted["visible"] + counted["occluded"] == counted["all"] == 600
    assert counted["slow"] + counted["medium"] + counted["fast"] == 600
    assert counted["occluded"] == hidden.sum()


def test_images_weigh_alike_or_by_their_pixels():
    """One image of 1 px off by 3, one of 99 px off by 1."""
    found = errors(np.full((1, 1, 2), (3.0, 0)), np.zeros((1, 1, 2)))
    found.add(np.full((9, 11, 2), (1.0, 0)), np.zeros((9, 11, 2)))
    assert found.of("all").epe_px == pytest.approx(1.02)
    assert found.of("all").epe_of_images_px == pytest.approx(2)


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
