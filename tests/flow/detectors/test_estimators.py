"""Today's estimators of OpenCV and scikit-image, on textures that drift by known fractions."""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from megalopta.flow.detectors.block_matching import BlockMatching
from megalopta.flow.detectors.gray_detector import gray_levels
from megalopta.flow.detectors.libraries import (
    DenseInverseSearch,
    Farneback,
    LucasKanade,
    PhaseCorrelation,
    TotalVariation,
)
from megalopta.flow.detectors.registry import METHODS

from ..textures import drifting_texture

ESTIMATORS = ("LK", "FB", "DIS", "TV-L1", "ILK", "PC")
DENSE = ("FB", "DIS", "TV-L1", "ILK")

# Largest mean error (px) on a texture without noise. LK stops at steps of 0.01 px and sees 8 bits;
# FB, TV-L1 and ILK interpolate linearly between pixels; DIS stops one level above the frames, so
# 0.03 px there are 0.06 px here; PC counts in steps of 0.05 px.
TOLERANCE_PX = {"LK": 0.02, "FB": 0.02, "DIS": 0.06, "TV-L1": 0.02, "ILK": 0.02, "PC": 0.051}


@pytest.mark.parametrize("velocity", [(1.3, -0.7), (-2.4, 1.6), (0.25, 0.0)])
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


def test_pictures_without_outliers_are_scaled_by_their_darkest_and_brightest_pixel():
    pair = np.random.default_rng(2).gamma(2.0, size=(2, 60, 80))
    expected = (pair - pair.min()) / (pair.max() - pair.min())
    np.testing.assert_array_equal(gray_levels(pair), expected)


@pytest.mark.parametrize("name", ["LK", *DENSE])
def test_velocities_belong_to_the_blocks_of_block_matching(name):
    # The left half stands still and the right one moves by whole pixels: both methods must put the
    # border into the same column of blocks, and answer the same on either side of it.
    moving, still = drifting_texture((2, 0), seed=1), drifting_texture((0, 0), seed=2)
    frames = np.concatenate((still[..., :84], moving[..., 84:]), axis=2)
    method = METHODS[name]
    assert method.grid((120, 160)) == BlockMatching().grid((120, 160))
    found, expected = (each.respond(frames)[0, 1:-1] for each in (method, BlockMatching()))
    away = np.array([1, 2, 3, 4, 8, 9, 10, 11])  # a block and a half away from the border
    np.testing.assert_allclose(
        np.median(found[:, away], axis=0), np.median(expected[:, away], axis=0), atol=0.1
    )
    np.testing.assert_array_equal(expected[:, away, 0].round(), [[0, 0, 0, 0, 2, 2, 2, 2]] * 8)


def test_lucas_kanade_has_no_velocity_exactly_where_the_window_has_no_texture():
    frames = drifting_texture((1, 0))
    frames[:, :, 80:] = 0.0
    found = LucasKanade(pyramid_levels=1).respond(frames)[0]
    known = np.isfinite(found).all(axis=-1)
    assert known[:, :6].all()
    assert not known[:, 8:].any()


@pytest.fixture
def three_threads():
    before = cv2.getNumThreads()
    cv2.setNumThreads(3)
    yield
    cv2.setNumThreads(before)


class _Recorded:
    """An estimator of OpenCV that notes how many threads it may use."""

    def __init__(self, calc, seen):
        self._calc, self._seen = calc, seen

    def __call__(self, *args, **keywords):
        self._seen.append(cv2.getNumThreads())
        return self._calc(*args, **keywords)

    calc = __call__


@pytest.mark.usefixtures("three_threads")
@pytest.mark.parametrize(
    ("name", "owner", "function"),
    [
        ("LK", cv2, "calcOpticalFlowPyrLK"),
        ("FB", cv2, "calcOpticalFlowFarneback"),
        ("DIS", cv2.DISOpticalFlow, "create"),
    ],
)
def test_estimators_of_opencv_run_in_one_thread_each(name, owner, function, monkeypatch):
    seen = []
    original = getattr(owner, function)
    if function == "create":
        replaced = staticmethod(lambda preset: _Recorded(original(preset).calc, seen))
    else:
        replaced = _Recorded(original, seen)
    monkeypatch.setattr(owner, function, replaced)
    frames = drifting_texture((1.3, -0.7), frames=8)
    with ThreadPoolExecutor(2) as pool:
        both = list(pool.map(METHODS[name].respond, [frames, frames]))
    np.testing.assert_array_equal(*both)
    assert seen == [1] * 14
    assert cv2.getNumThreads() == 3


def test_presets_and_weights_reach_the_libraries():
    texture = drifting_texture((1.3, 0))
    counts = np.random.default_rng(3).poisson(4 * (1 + 0.25 * texture / texture.std()).clip(0))
    for method, changed in (
        (DenseInverseSearch(), DenseInverseSearch(preset="ultrafast")),
        (TotalVariation(), TotalVariation(attachment=5)),
        (LucasKanade(), LucasKanade(window_blocks=3)),
        (Farneback(), Farneback(window_blocks=3)),
        (PhaseCorrelation(), PhaseCorrelation(whitened=False)),
        (PhaseCorrelation(), PhaseCorrelation(steps_per_px=3)),
    ):
        assert not np.array_equal(method.respond(counts), changed.respond(counts))


def test_dense_inverse_search_names_the_size_it_needs():
    with pytest.raises(ValueError, match=r"9 × 10 px: DIS needs at least 12 px"):
        DenseInverseSearch(block_px=3).respond(np.ones((2, 9, 10)))
