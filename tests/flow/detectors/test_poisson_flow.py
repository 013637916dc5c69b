"""Poisson flow: its linear system, its motion, and its variance against the bound."""

import numpy as np
import pytest

from megalopta.flow.detectors import BlockGrid
from megalopta.flow.detectors.node_system import most_likely
from megalopta.flow.detectors.poisson_flow import PoissonFlow
from megalopta.flow.detectors.pooled_flow import PooledFlow
from megalopta.flow.metrics import fisher_information

from ..textures import drifting_texture

SHAPE = (64, 80)
VELOCITY = (2.3, -1.1)


def light(velocity=VELOCITY, frames=2, shape=SHAPE, seed=0):
    """A texture of 30 % contrast and mean 1."""
    texture = drifting_texture(velocity, frames, shape, blur_px=2.0, seed=seed)
    return (1 + 0.3 * texture / texture.std()).clip(0.05)


def draw(clean, flux, seed=0):
    return np.random.default_rng(seed).poisson(flux * clean).astype(np.uint16)


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

    found = most_likely(np.stack((xx, xy, yy)), slope, (right, down)).ravel()
    # a quadratic form has equal, higher values on both sides of its minimum, along every axis
    for step in 0.1 * np.eye(found.size):
        assert energy(found + step) == pytest.approx(energy(found - step), abs=1e-6)
        assert energy(found + step) > energy(found)


def test_nodes_without_evidence_lie_on_a_line_between_those_that_have_it():
    information, slope = np.zeros((3, 1, 5)), np.zeros((2, 1, 5))
    information[[0, 2], :, ::4] = 1e9
    slope[0, 0, 4] = 8e9
    found = most_likely(information, slope, (np.ones((1, 4)), np.ones((0, 5))))
    np.testing.assert_allclose(found[0, 0], (0, 2, 4, 6, 8), atol=1e-5)
    np.testing.assert_allclose(found[1, 0], 0, atol=1e-5)


def test_many_photons_tell_fractions_of_a_pixel():
    flow = PoissonFlow().dense(*draw(light(), 1000))
    assert flow.shape == (*SHAPE, 2)
    error = np.hypot(*np.moveaxis(flow[8:-8, 8:-8] - VELOCITY, -1, 0))
    # 30 % of contrast blurred by 2 px: 8 × 8 px bound each velocity to 0.05 px; the prior adds little
    assert np.median(error) < 0.1


def test_an_edge_of_the_motion_stays_where_it_is():
    left, right = light((1.5, 0.5), seed=1), light((-1.5, 0.5), seed=2)
    clean = np.concatenate((left[..., :40], right[..., 40:]), axis=-1)
    flow = PoissonFlow().dense(*draw(clean, 300))
    assert np.median(flow[8:-8, 8:32, 0]) == pytest.approx(1.5, abs=0.1)
    assert np.median(flow[8:-8, 48:-8, 0]) == pytest.approx(-1.5, abs=0.1)


def test_variance_of_one_velocity_for_all_is_near_the_bound():
    """Stiff as a board, the flow is one velocity of all pixels; two noisy frames: var ≥ 2/J."""
    clean, flux = light((1.2, 0.4), shape=(48, 48)), 20
    stiff = PoissonFlow(smoothness=1e4)
    found = [stiff.dense(*draw(clean, flux, seed)).mean(axis=(0, 1)) for seed in range(24)]
    information = fisher_information(flux * clean[0], BlockGrid((48, 48), 48))[0, 0]
    bound = 2 * np.linalg.inv(information)
    # 48 squares over their mean scatter by 20 %; five standard deviations below and above
    ratio = np.mean((np.array(found) - (1.2, 0.4)) ** 2, axis=0) / np.diag(bound)
    assert 0.3 < ratio.mean() < 3


def test_eight_frames_need_fewer_photons_than_two():
    clean = light(frames=8)
    counts = draw(clean, 1.0)
    two = PoissonFlow().dense(*counts[3:5]) - VELOCITY
    eight = PooledFlow().dense(*counts) - VELOCITY
    assert np.median(np.hypot(*eight.T)) < np.median(np.hypot(*two.T)) / 2


def test_without_photons_there_is_no_velocity():
    assert np.isnan(PoissonFlow().respond(np.zeros((2, 60, 60), np.uint16))).all()


def test_blocks_have_the_mean_of_the_flow():
    counts = draw(light(), 30)
    detector = PoissonFlow(block_px=16)
    blocks = detector.respond(counts)[0]
    flow = detector.dense(*counts)
    np.testing.assert_allclose(blocks[1, 2], flow[16:32, 32:48].mean(axis=(0, 1)))
