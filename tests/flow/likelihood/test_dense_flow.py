"""Poisson flow: evidence of aligned frames, search, the system of nodes, and its covariance."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates, spline_filter

from megalopta.flow.likelihood import messages
from megalopta.flow.likelihood.dense_flow import (
    dispersion_of,
    evidence,
    likelihood_flow,
    most_likely,
    node_covariance,
)
from megalopta.flow.likelihood.roots import BORDER_PX, NODE_PX, interpolate, level_of
from megalopta.flow.likelihood.search import with_large_motion

from ..textures import drifting_texture

SHAPE = (60, 72)
TIMES = np.arange(4.0) - 1
STEADY = TIMES[np.newaxis]
PATTERNS = np.stack((TIMES, TIMES * (TIMES - 1) / 2))
"""A velocity, and its change from frame to frame"""


def drawn(photons, texture, seed=0):
    light = (1 + 0.3 * texture / texture.std()).clip(0.05)
    return np.random.default_rng(seed).poisson(photons * light).astype(float)


def drifting(photons, blur_px=2.0):
    return drawn(photons, drifting_texture((1.2, -0.7), 4, SHAPE, blur_px=blur_px))


def places(velocity, change=(0, 0)):
    pixels = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    moved = PATTERNS.T @ np.array((velocity[::-1], change[::-1]))
    return [pixels + each[:, np.newaxis, np.newaxis] for each in moved]


def squares(level, motion, inside):
    """Twice the squared differences of the roots, aligned, from their mean."""
    aligned = np.stack(
        [
            map_coordinates(splines, where + BORDER_PX, order=3, mode="nearest", prefilter=False)
            for splines, where in zip(level.splines, places(*motion), strict=True)
        ]
    )
    return 2 * ((aligned - aligned.mean(axis=0)) ** 2).sum(axis=0)[inside].sum()


@pytest.mark.parametrize("pattern", [0, 1])
def test_slope_is_that_of_the_squared_differences(pattern):
    level = level_of(drifting(3000, blur_px=4.0))
    at = np.array([[1.2, -0.7], [0, 0]])
    at[pattern] += (-0.03, 0.02)
    aligned = evidence(level, PATTERNS, places(*at))
    inside = np.zeros(SHAPE, bool)
    inside[8:-8, 8:-8] = True
    assert aligned.misfit < 2  # so that all evidence counts whole
    for axis in range(2):
        step = np.zeros((2, 2))
        step[pattern, axis] = 0.01
        rise = squares(level, at + step, inside) - squares(level, at - step, inside)
        # A difference of pixels is the gradient of a wave of 2π·4 px to 1 %. That of the mean leaves
        # out what the noise of each frame shares with its own gradient.
        slope = aligned.slope[pattern, axis][inside].sum()
        assert slope == pytest.approx(-rise / 0.02, rel=0.08)


def test_aligned_frames_differ_by_their_noise():
    aligned = evidence(level_of(drifting(50)), STEADY, places((1.2, -0.7)))
    # roots of means of 50 have a quarter of a photon's variance to 1 %, interpolation takes some
    assert aligned.misfit == pytest.approx(1, abs=0.15)
    assert evidence(level_of(drifting(50)), STEADY, places((-1.2, 0.7))).misfit > 2


def test_splines_between_pixels_are_those_of_scipy():
    level = level_of(drifting(50))
    frame, inside = np.empty(SHAPE), np.ones(SHAPE, bool)
    where = places((-3.3, 5.6))[2]
    interpolate(level.splines[0], where, frame, inside)
    smooth = spline_filter(level.roots[0], 3, mode="nearest")
    expected = map_coordinates(smooth, where, order=3, mode="nearest", prefilter=False)
    np.testing.assert_allclose(frame, expected, rtol=1e-12)
    assert inside.sum() == (SHAPE[0] - 6) * (SHAPE[1] - 3)


def test_a_frame_of_twice_the_light_is_equal_evidence():
    counts = drifting(200)
    brighter = counts * np.array([1, 2, 1, 1])[:, np.newaxis, np.newaxis]
    same, twice = (
        evidence(level_of(each), STEADY, places((1.2, -0.7))) for each in (counts, brighter)
    )
    # Equal brightness of all, that of the mean root: ((3 + √2)/4)² = 1.22. The slope at the right
    # motion is noise, the information is not.
    assert twice.information.sum() == pytest.approx(1.22 * same.information.sum(), rel=0.05)
    assert twice.misfit == pytest.approx(same.misfit, rel=0.3)


@pytest.mark.parametrize("dispersion", [1.0001, 3])
def test_dispersion_is_the_variance_over_the_mean(dispersion):
    """Of negative binomial counts, nearly Poisson if both are equal."""
    shape, velocity = (112, 128), (1.2, -0.7)
    texture = drifting_texture(velocity, 2, shape, blur_px=3.0)
    light = 100 * (1 + 0.2 * texture / texture.std()).clip(0.2)
    rng = np.random.default_rng(0)
    counts = rng.negative_binomial(light / (dispersion - 1), 1 / dispersion)
    flow = np.broadcast_to(np.reshape(velocity, (2, 1, 1)), (2, 28, 32))
    assert dispersion_of(counts * 1.0, flow, np.inf) == pytest.approx(dispersion, rel=0.1)


EXACT = 1e-20
"""Energy per node that conjugate gradients may leave"""


def system(shape, seed=0):
    """Positive definite information, a slope, and weights of links."""
    rng = np.random.default_rng(seed)
    sides = rng.normal(size=(2, 2, *shape))
    information = np.stack(
        [(sides[:, i] * sides[:, j]).sum(0) for i, j in ((0, 0), (0, 1), (1, 1))]
    )
    weights = rng.random((shape[0], shape[1] - 1)), rng.random((shape[0] - 1, shape[1]))
    return information, rng.normal(size=(2, *shape)), weights


def test_solution_minimizes_the_energy():
    (xx, xy, yy), slope, (right, down) = system((3, 4))

    def energy(u):
        u = u.reshape(slope.shape)
        of_evidence = xx * u[0] ** 2 + 2 * xy * u[0] * u[1] + yy * u[1] ** 2
        of_links = (right * np.diff(u, axis=2) ** 2).sum() + (down * np.diff(u, axis=1) ** 2).sum()
        return (of_evidence.sum() + of_links) / 2 - (slope * u).sum()

    solved = most_likely(np.stack((xx, xy, yy)), slope, (right, down), slope, EXACT).ravel()
    # a quadratic form has equal, higher values on both sides of its minimum, along every axis
    for step in 0.1 * np.eye(solved.size):
        assert energy(solved + step) == pytest.approx(energy(solved - step), abs=1e-6)
        assert energy(solved + step) > energy(solved)


@pytest.mark.parametrize("shape", [(3, 5), (5, 3), (1, 4)])
def test_covariances_are_blocks_of_the_inverse(shape):
    """A column of the inverse solves the system for a unit slope, by other code."""
    information, _, weights = system(shape)
    covariance = node_covariance(information, weights)
    for place in np.ndindex(shape):
        for axis in range(2):
            slope = np.zeros((2, *shape))
            slope[(axis, *place)] = 1
            column = most_likely(information, slope, weights, slope, EXACT)
            # `most_likely` adds 1e-9 to the diagonal
            here = covariance[(slice(axis, axis + 2), *place)]
            np.testing.assert_allclose(here, column[(slice(None), *place)], rtol=1e-6)


WIDE = (64, 80)
NODES = (2, WIDE[0] // NODE_PX, WIDE[1] // NODE_PX)


def square_over_ground(fast=(7, -3)):
    """A ground at rest, and a square of 24 px with another motion, in two frames."""
    texture, square = (
        drifting_texture(velocity, 2, WIDE, blur_px=1.5, seed=seed)
        for seed, velocity in enumerate(((0.0, 0.0), fast))
    )
    for frame in range(2):
        inside = np.s_[frame, 24 + frame * fast[1] :, 20 + frame * fast[0] :]
        texture[inside][:24, :24] = square[inside][:24, :24]
    return level_of(drawn(30.0, texture))


def test_a_fast_square_over_still_ground_is_found():
    flow = with_large_motion(square_over_ground(), 2, np.zeros(NODES))
    np.testing.assert_array_equal(flow[0, 7:11, 6:10], 7)
    np.testing.assert_array_equal(flow[1, 7:11, 6:10], -3)
    # the content of pixels that the square hides in the second frame may seem to move
    far = np.ones(NODES[1:], bool)
    far[3:14, 3:15] = False
    assert not flow[:, far].any()


def test_a_flow_that_is_right_moves_by_no_more_than_rounding():
    right = np.zeros(NODES)
    right[0, 6:12, 5:11], right[1, 6:12, 5:11] = 7.02, -2.98
    flow = with_large_motion(square_over_ground(), 2, right)
    assert np.abs(flow - right)[:, 7:11, 6:10].max() < 0.03
    assert not flow[:, :3].any() and not flow[:, 14:].any()


def test_messages_along_a_row_are_least_costs():
    """Of three nodes in a row, the middle one's, by trying all displacements of the others."""
    costs = np.random.default_rng(0).uniform(0, 4, (1, 3, 10)).astype(np.float32)
    total = costs.copy()
    messages.add_messages(costs, np.full((2, 1, 3), 5.0), total)  # flow so far beyond reach
    labels = np.array(list(np.ndindex(3, 3)))
    apart = np.abs(labels[:, np.newaxis] - labels).sum(axis=-1)
    change = np.full((10, 10), 3.0)
    change[:9, :9] = np.where(apart == 1, 0.7, 3.0)
    np.fill_diagonal(change, 0)
    left, middle, right = costs[0]
    least = middle + (left + change).min(axis=1) + (right + change).min(axis=1)
    np.testing.assert_allclose(total[0, 1] - total[0, 1].min(), least - least.min(), atol=1e-5)


def test_frames_narrower_than_the_longest_displacement_have_a_flow():
    counts = drawn(30.0, drifting_texture((0.0, 0.0), 2, (24, 24)))[:, :6, :5]
    assert np.isfinite(with_large_motion(level_of(counts), 2, np.zeros((2, 2, 2)))).all()


def test_a_motion_of_a_fifth_of_the_width_is_found():
    texture = drifting_texture((60.0, 0.0), 2, (64, 320), blur_px=3.0, margin=40)
    light = (1 + 0.3 * texture / texture.std()).clip(0.05)
    flow = likelihood_flow(np.random.default_rng(0).poisson(30 * light), 0.2)
    stays = flow[8:-8, 8:-68]
    assert np.median(np.hypot(*np.moveaxis(stays - (60, 0), -1, 0))) < 0.2
