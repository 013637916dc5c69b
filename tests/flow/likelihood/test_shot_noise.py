import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, uniform_filter

from megalopta.flow.likelihood import root_noise, suited_blur_px


def test_roots_of_counts_have_a_quarter_of_what_smoothing_leaves():
    assert root_noise(np.copy) == 0.25
    assert root_noise(lambda image: uniform_filter(image, 3)) == pytest.approx(0.25 / 9)
    # ∫ of a squared Gaussian; sampling it at whole pixels changes 1e-6 at this width
    wide = root_noise(lambda image: gaussian_filter(image, 2.0))
    assert wide == pytest.approx(0.25 / (4 * np.pi * 2.0**2), rel=1e-3)


def test_blur_goes_as_the_cubic_root_of_noise_over_texture():
    assert suited_blur_px(np.array(1.0), 2) == pytest.approx(0.6)
    np.testing.assert_allclose(suited_blur_px(np.array([8.0, 1.0]), 2), [0.3, 0.6])
    np.testing.assert_allclose(suited_blur_px(np.array(1.0), 16), 0.3)
    assert suited_blur_px(np.array(-0.1), 2) == suited_blur_px(np.array(0.0), 2)
