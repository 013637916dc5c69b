"""Shot noise and blur, evidence of aligned frames, and the system of evidence and smoothness."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates, uniform_filter

from megalopta.flow.likelihood import (
    MostLikely,
    evidence,
    level_of,
    root_noise,
    without_defects,
)

from .textures import drifting_texture

SHAPE = (60, 72)
TIMES = np.arange(4.0) - 1
STEADY = TIMES[np.newaxis]
PATTERNS = np.stack((TIMES, TIMES * (TIMES - 1) / 2))
"""A velocity, and its change from frame to frame"""


def frames(photons, velocity=(1.2, -0.7), seed=0, blur_px=2.0):
    texture = drifting_texture(velocity, 4, SHAPE, blur_px=blur_px, seed=seed)
    light = (1 + 0.3 * texture / texture.std()).clip(0.05)
    return np.random.default_rng(seed).poisson(photons * light).astype(float)


def places(velocity, change=(0, 0)):
    pixels = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    moved = PATTERNS.T @ np.array((velocity[::-1], change[::-1]))
    return [pixels + each[:, np.newaxis, np.newaxis] for each in moved]


def squares(level, motion, inside):
    """Twice the squared differences of the roots, aligned, from their mean."""
    aligned = np.stack(
        [
            map_coordinates(splines, where, order=3, mode="nearest", prefilter=False)
            for splines, where in zip(level.splines, places(*motion), strict=True)
        ]
    )
    return 2 * ((aligned - aligned.mean(axis=0)) ** 2).sum(axis=0)[inside].sum()


@pytest.mark.parametrize("pattern", [0, 1])
def test_slope_is_that_of_the_squared_differences(pattern):
    level = level_of(frames(3000, blur_px=4.0))
    at = np.array([[1.2, -0.7], [0, 0]])
    at[pattern] += (-0.03, 0.02)
    found = evidence(level, PATTERNS, places(*at))
    inside = np.zeros(SHAPE, bool)
    inside[8:-8, 8:-8] = True
    assert found.misfit < 2  # so that all evidence counts whole
    for axis in range(2):
        step = np.zeros((2, 2))
        step[pattern, axis] = 0.01
        rise = squares(level, at + step, inside) - squares(level, at - step, inside)
        # A difference of pixels is the gradient of a wave of 2π·4 px to 1 %. That of the mean leaves
        # out what the noise of each frame shares with its own gradient.
        slope = found.slope[pattern, axis][inside].sum()
        assert slope == pytest.approx(-rise / 0.02, rel=0.08)


def test_aligned_frames_differ_by_their_noise():
    found = evidence(level_of(frames(50)), STEADY, places((1.2, -0.7)))
    # roots of means of 50 have a quarter of a photon's variance to 1 %, interpolation takes some
    assert found.misfit == pytest.approx(1, abs=0.15)
    wrong = evidence(level_of(frames(50)), STEADY, places((-1.2, 0.7)))
    assert wrong.misfit > 2


def test_system_of_nodes_is_solved_as_a_dense_matrix_would_be():
    rng = np.random.default_rng(0)
    n, m = 3, 4
    roots = rng.normal(size=(2, 2, n, m))
    xx, xy, yy = (
        np.einsum("knm,knm->nm", roots[:, i], roots[:, j]) for i, j in ((0, 0), (0, 1), (1, 1))
    )
    slope = rng.normal(size=(2, n, m))
    right, down = rng.random((n, m - 1)), rng.random((n - 1, m))

    def energy(u):
        u = u.reshape(2, n, m)
        evidence = xx * u[0] ** 2 + 2 * xy * u[0] * u[1] + yy * u[1] ** 2
        links = (right * np.diff(u, axis=2) ** 2).sum() + (down * np.diff(u, axis=1) ** 2).sum()
        return (evidence.sum() + links) / 2 - (slope * u).sum()

    found = MostLikely()(np.stack((xx, xy, yy)), slope, (right, down), slope).ravel()
    # a quadratic form has equal, higher values on both sides of its minimum, along every axis
    for step in 0.1 * np.eye(found.size):
        assert energy(found + step) == pytest.approx(energy(found - step), abs=1e-6)
        assert energy(found + step) > energy(found)


def test_a_system_is_solved_alike_after_similar_ones_and_after_very_different_ones():
    rng = np.random.default_rng(0)
    shape = (12, 15)
    information = np.stack([1 + rng.random(shape), rng.random(shape) / 2, 1 + rng.random(shape)])
    slope = rng.normal(size=(2, *shape))
    springs = rng.random((12, 14)), rng.random((11, 15))
    after = MostLikely()
    for factor in (1.0, 1.3, 1e6):  # solved by factors, by conjugate gradients, by new factors
        system = information, slope, tuple(factor * each for each in springs)
        found = after(*system, np.zeros_like(slope))
        alone = MostLikely()(*system, slope)
        # residuals of 1e-6 of the slope, over information of 1 and more
        np.testing.assert_allclose(found, alone, atol=2e-6 * np.linalg.norm(slope))
    assert np.ptp(found, axis=(1, 2)).max() < 1e-4  # so stiff that all move alike


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
    left = without_defects(counts)
    changed = np.argwhere((left != counts).any(axis=0)).tolist()
    assert changed == [[5, 5], [5, 6], [12, 12]]
    assert left[:, [5, 5, 12], [5, 6, 12]].max() < 60


def test_a_frame_of_twice_the_light_says_the_same_of_motion():
    counts = frames(200)
    brighter = counts * np.array([1, 2, 1, 1])[:, np.newaxis, np.newaxis]
    same, found = (
        evidence(level_of(each), STEADY, places((1.2, -0.7))) for each in (counts, brighter)
    )
    # Equal brightness of all, that of the mean root: ((3 + √2)/4)² = 1.22. The slope at the right
    # motion is noise, the information is not.
    assert found.information.sum() == pytest.approx(1.22 * same.information.sum(), rel=0.05)
    assert found.misfit == pytest.approx(same.misfit, rel=0.3)
