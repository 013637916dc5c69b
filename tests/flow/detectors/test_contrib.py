"""Estimators of OpenCV's contributed modules, where they are installed."""

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from megalopta.benchmark.methods import block_detector
from megalopta.flow import METHODS, optical_flow

NAMES = ("RLOF", "PCAFlow", "DeepFlow")


@pytest.mark.parametrize("name", NAMES)
def test_an_estimator_finds_a_shift_or_says_what_is_missing(name):
    texture = gaussian_filter(np.random.default_rng(0).random((120, 150)), 2, mode="wrap")
    frames = texture, np.roll(texture, (1, 3), axis=(0, 1))
    assert name not in METHODS
    if not hasattr(cv2, "optflow"):
        with pytest.raises(ValueError, match=f"{name} needs .*opencv-contrib-python-headless"):
            optical_flow(*frames, name)
        return
    flow = optical_flow(*frames, name.lower())
    # gray levels are rounded to 8 bits; the rim, where the content leaves, is not compared
    np.testing.assert_allclose(np.median(flow[10:-10, 10:-10], axis=(0, 1)), (3, 1), atol=0.05)
    assert block_detector(f"{name} √").name == f"{name} √"
