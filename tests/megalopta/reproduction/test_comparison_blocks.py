"""Figure "detection": what must hold at the ends of the curves, and for the blind methods."""

import numpy as np
import pytest

from megalopta.benchmark import textures as detection_sweep
from megalopta.benchmark.textures import RESPONSES, SCORED_FRAMES, VIEWS
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.detection import d_prime, motion_evidence
from megalopta.reproduction.comparison_blocks import detection_figure

# Two samples of 1024 responses of equal distribution: the standard error of d′ is 0.044, up to twice
# that with responses of the same texture alike; five of them.
NOTHING = 0.45
LIMIT = d_prime(np.zeros(RESPONSES), np.ones(RESPONSES))


@pytest.fixture(scope="module")
def figure():
    return detection_figure(["BM", "EMD", "NDM", "FB"], (300.0, 1e6))


@pytest.fixture(scope="module")
def values(figure):
    return {(row[0], row[1]): dict(zip(figure.columns, row, strict=True)) for row in figure.rows}


@pytest.mark.parametrize("method", ["BM", "EMD", "NDM", "FB"])
def test_dark_counts_alone_tell_nothing(method, values):
    # 300 photons among 6300 dark counts.
    assert abs(values[method, 300.0]["d_prime_motion"]) < NOTHING
    assert abs(values[method, 300.0]["d_prime_direction"]) < NOTHING
    assert values[method, 300.0]["false_alarm_rate"] > 0.5


@pytest.mark.parametrize("method", ["BM", "EMD", "NDM", "FB"])
def test_bright_scenes_tell_motion_from_standstill(method, values):
    # A four-bit error in most methods: the distributions hardly overlap.
    assert values[method, 1e6]["d_prime_motion"] > 5
    assert values[method, 1e6]["false_alarm_rate"] < 0.01


@pytest.mark.parametrize("method", ["BM", "EMD", "FB"])
def test_bright_scenes_tell_right_from_left(method, values):
    assert values[method, 1e6]["d_prime_direction"] == pytest.approx(LIMIT)


def test_non_directional_multiplication_is_blind_to_direction(values):
    assert abs(values["NDM", 1e6]["d_prime_direction"]) < NOTHING


def test_threshold_of_a_method_that_takes_counts_is_half_of_its_response_to_bright_ones():
    flux, method = 1e9, METHODS["PM"]
    counts = [
        detection_sweep.noisy_frames("right", view, 1 + SCORED_FRAMES, flux)
        for view in range(VIEWS)
    ]
    responses = motion_evidence(method, detection_sweep.settled_responses(method, counts, flux))
    # 3e5 photons per pixel leave noise of 0.2 %
    assert detection_sweep.motion_threshold(method) == pytest.approx(
        np.median(responses) / 2, rel=0.01
    )
