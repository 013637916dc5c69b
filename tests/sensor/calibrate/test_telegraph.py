"""Telegraph noise: pixels that are called so by chance."""

import numpy as np

from megalopta.sensor.calibrate.telegraph import correlation


def test_rare_events_are_seldom_taken_for_telegraph_noise():
    # Beyond 4.5 standard deviations are 3.4e-6 of a normal variable, so 0.85 of both sums of 125,000
    # pixels. 10 or more have a probability below 1e-6. Without regard to the skewness of rare
    # events there are 16.
    bits = np.random.default_rng(0).random((400, 250, 500), np.float32) < 0.12
    found = correlation(bits.view(np.uint8), np.ones((250, 500), np.bool_))
    assert (found.deviation > 4.5).sum() < 10
