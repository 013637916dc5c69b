"""One bound of drifts for codes, counts and bits: chance, and half a percent of a pixel's noise."""

import pytest

from megalopta.sensor.calibrate.steadiness import Drift, check_steadiness


@pytest.mark.parametrize("sigma", [0.1, 3.0, 100.0], ids=["bits", "quiet codes", "codes"])
def test_a_drift_above_half_a_percent_of_the_noise_is_refused(sigma):
    check_steadiness("dark", Drift(0.0049 * sigma, 1e-4 * sigma), sigma)
    check_steadiness("dark", Drift(0.2 * sigma, 0.04 * sigma), sigma)  # 5 standard errors: chance
    with pytest.raises(
        ValueError, match=r"dark: drifts; .* by \+0.0051 times the noise of a pixel, 51"
    ):
        check_steadiness("dark", Drift(0.0051 * sigma, 1e-4 * sigma), sigma)
