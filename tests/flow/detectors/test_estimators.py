"""Today's estimators of OpenCV and scikit-image, on textures that drift by known fractions."""

import cv2
import numpy as np
import pytest

from megalopta.benchmark.methods import methods_and_baselines
from megalopta.flow.detectors.libraries import LucasKanade, one_thread
from megalopta.flow.detectors.registry import METHODS

from ..textures import drifting_texture

CONTRIBUTED = ("DualTVL1", "DeepFlow", "PCAFlow", "RLOF")
ESTIMATORS = ("LK", "FB", "DIS", "TV-L1", "ILK", "PC", *CONTRIBUTED)
DENSE = ("FB", "DIS", "TV-L1", "ILK", *CONTRIBUTED)

# Largest mean error (px) on a texture without noise. LK stops at steps of 0.01 px and sees 8 bits;
# FB, TV-L1 and ILK interpolate linearly between pixels; DIS stops one level above the frames, so
# 0.03 px there are 0.06 px here; DualTVL1 is drawn toward whole pixels by its median filter; PC
# counts in steps of 0.05 px.
TOLERANCE_PX = dict.fromkeys(ESTIMATORS, 0.02) | {"DIS": 0.06, "DualTVL1": 0.04, "PC": 0.051}


@pytest.mark.parametrize("velocity", [(1.3, -0.7), (-2.4, 1.6)])
@pytest.mark.parametrize("name", ESTIMATORS)
def test_texture_has_the_velocity_that_it_drifts_with(name, velocity):
    found = METHODS[name].respond(drifting_texture(velocity, frames=3))[:, 1:-1, 1:-1]
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found.mean(axis=(0, 1, 2)), velocity, atol=TOLERANCE_PX[name])
    # Single blocks of 12 px scatter, with what enters and leaves them.
    assert np.hypot(*(found - velocity).std(axis=(0, 1, 2))) < 0.1


@pytest.mark.parametrize("name", ["LK", *DENSE])
def test_a_hot_pixel_spoils_its_surroundings_only(name):
    texture = 1 + 0.25 * drifting_texture((1.3, -0.7), frames=2)
    bright = texture.copy()
    bright[:, 30, 100] = 1000 * texture.max()
    found = METHODS[name].respond(bright)[0, 1:-1, 1:-1]
    np.testing.assert_allclose(np.median(found, axis=(0, 1)), (1.3, -0.7), atol=0.06)
    wrong = np.hypot(*(found - (1.3, -0.7)).transpose(2, 0, 1)) > 0.5
    assert wrong.mean() < 0.15


@pytest.mark.parametrize("window_px", [None, 15])
@pytest.mark.parametrize("shape", [(6, 24), (36, 40), (61, 63)])
def test_few_points_in_the_dark_give_the_same_flow_twice(window_px, shape):
    """OpenCV reads and writes beyond its memory where RLOF and PCA-Flow have few points."""
    pairs = [np.random.default_rng(seed).poisson(0.2, (2, *shape)) for seed in range(5)]
    for method in (METHODS["RLOF"].model_copy(update={"window_px": window_px}), METHODS["PCAFlow"]):
        first, second = (
            [method.model_copy(update={"block_px": 2}).dense(*pair) for pair in pairs] for _ in "12"
        )
        np.testing.assert_array_equal(first, second)


def test_a_pair_without_corners_has_no_velocity_by_pca_flow():
    ramp = np.linspace(0, 1, 60) * np.ones((60, 1))
    assert np.isnan(METHODS["PCAFlow"].dense(ramp, ramp)).all()


def test_zero_motion_is_zero_and_a_baseline_like_any_other():
    frames = drifting_texture((1.3, -0.7))
    assert not METHODS["zero"].dense(*frames).any()
    assert "zero" in [method.name for method in methods_and_baselines()]


def test_lucas_kanade_has_no_velocity_exactly_where_the_window_has_no_texture():
    frames = drifting_texture((1, 0))
    frames[:, :, 80:] = 0.0
    found = LucasKanade(pyramid_levels=1).respond(frames)[0]
    known = np.isfinite(found).all(axis=-1)
    assert known[:, :6].all()
    assert not known[:, 8:].any()


def test_estimators_of_opencv_run_in_one_thread_until_the_last_has_left(monkeypatch):
    before, numbers, set_number = cv2.getNumThreads(), [], cv2.setNumThreads
    cv2.setNumThreads(3)
    with one_thread():
        for name in ("LK", "FB", "DIS"):
            METHODS[name].respond(drifting_texture((1.3, -0.7)))
            assert cv2.getNumThreads() == 1
    assert cv2.getNumThreads() == 3
    monkeypatch.setattr(cv2, "setNumThreads", lambda n: numbers.append(n) or set_number(n))
    for name in ("LK", "FB", "DIS"):
        METHODS[name].respond(drifting_texture((1.3, -0.7)))
    assert numbers == [1, 3] * 3
    cv2.setNumThreads(before)
