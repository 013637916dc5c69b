"""The intensity measurement against the mean absolute deviation of the Poisson distribution."""

import numpy as np
import pytest
from scipy.stats import poisson

from megalopta.flow.detectors.intensity import IntensityMeasurement, mean_absolute_deviation
from megalopta.flow.metrics.response_error import error_of, error_sums
from megalopta.flow.stimuli.photons import draw_counts


@pytest.mark.parametrize("mean", [0.5, 3.7, 10.133, 162.9])
@pytest.mark.parametrize("metric", ["literal", "ratio"])
def test_error_on_a_flat_image_is_the_mean_absolute_deviation(mean, metric):
    # E|X − λ|/λ = 2 e^−λ λ^⌊λ⌋/⌊λ⌋! = 2 P(X = ⌊λ⌋); |z| < 5 fails with probability 6e-7.
    detector = IntensityMeasurement()
    means = np.full((10, 102, 102), mean)
    counts = draw_counts(means, 0, "flat")
    sums = error_sums(detector, detector.respond(means), detector.respond(counts))
    expected = 2 * poisson.pmf(np.floor(mean), mean)
    spread = np.sqrt((1 / mean - expected**2) / 1e5)
    assert abs(error_of(sums, metric) - expected) < 5 * spread


@pytest.mark.parametrize("mean", [1e5, 0.999e6, 1.001e6, 1e14])
def test_deviation_of_many_photons_is_that_of_a_normal_variable(mean):
    # Stirling: √(2λ/π) to within 1/λ, and rounding of the exponent at 1e6, below 1e-8
    assert mean_absolute_deviation(mean) == pytest.approx(np.sqrt(2 * mean / np.pi), rel=1e-5)
