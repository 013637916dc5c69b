"""Roots of smoothed counts, and defects."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, uniform_filter

from megalopta.flow.likelihood.roots import root_noise, without_defects


def test_roots_of_counts_have_a_quarter_of_what_smoothing_leaves():
    assert root_noise(np.copy) == 0.25
    assert root_noise(lambda image: uniform_filter(image, 3)) == pytest.approx(0.25 / 9)
    # ∫ of a squared Gaussian; sampling it at whole pixels changes 1e-6 at this width
    wide = root_noise(lambda image: gaussian_filter(image, 2.0))
    assert wide == pytest.approx(0.25 / (4 * np.pi * 2.0**2), rel=1e-3)


def test_a_hot_and_a_dead_pixel_are_replaced_and_a_moving_spot_is_not():
    counts = np.random.default_rng(0).poisson(30.0, (2, 20, 20))
    counts[:, 5, 5] = 400
    counts[:, 5, 6] = 300  # two side by side
    counts[:, 12, 12] = 0
    counts[0, 15, 4] = counts[1, 15, 5] = 400
    counts[0, 8, 14], counts[1:, 8, 14] = 300, 600  # a bright speck replaces another
    repaired = without_defects(counts)
    changed = np.argwhere((repaired != counts).any(axis=0)).tolist()
    assert changed == [[5, 5], [5, 6], [12, 12]]
    assert repaired[:, [5, 5, 12], [5, 6, 12]].max() < 60
