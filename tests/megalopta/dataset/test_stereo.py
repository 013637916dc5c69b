"""Disparity in files: exact to half a step of each layout, and unknown beyond its range."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from megalopta.config.model import load
from megalopta.dataset.sintel import read_disparity, write_disparity, write_kitti_disparity
from megalopta.dataset.store import Dataset


@pytest.fixture
def flow():
    """Flow to a camera on the right, wide enough for any disparity."""
    disparity = np.array([[0.0, 3.3, 255.9, 256.1], [1023.9, 1023.99999, 1024.0, 5000.0]])
    seen = np.zeros(disparity.shape, bool)
    way = np.stack([-disparity, np.zeros(disparity.shape)], axis=-1)
    return SimpleNamespace(displacement=way, occluded=seen, out_of_view=seen)


def test_disparities_beyond_the_range_of_sintel_are_unknown_and_masked(flow, tmp_path):
    write_disparity(Dataset(tmp_path, load("demo", {"name": "a"})), 0, flow, 0.1)
    stored = read_disparity(tmp_path / "training/disparities/a/frame_0001.png")
    unknown = np.isnan(stored)
    assert unknown.tolist() == [[False] * 4, [False, True, True, True]]
    expected = -flow.displacement[..., 0]
    np.testing.assert_allclose(stored[~unknown], expected[~unknown], rtol=0, atol=2**-15)
    path = tmp_path / "training/occlusions_stereo/a/frame_0001.png"
    mask = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(mask > 0, unknown)


def test_unknown_disparities_stay_so_in_kitti_s_layout(tmp_path):
    disparity = np.array([[0.0, 3.3, 255.9, 256.1, np.nan]])
    write_kitti_disparity(tmp_path / "a.png", disparity)
    codes = cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(codes, [[1, 845, 65510, 0, 0]])  # a code of 0 is unknown
