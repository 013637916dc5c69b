"""The motion of a part reaches its outline."""

import numpy as np
import pytest

from megalopta.flow.likelihood.alignment import finer, to_nodes
from megalopta.flow.likelihood.edges import sharpen, spread
from megalopta.flow.likelihood.roots import NODE_PX, level_of

from ..textures import drifting_texture

SHAPE, FAST = (80, 96), (7.0, -3.0)


@pytest.fixture(scope="module")
def disk():
    """Roots of two frames of a disk of 20 px over still ground, and what it covers in each."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] - np.array([44.0, 44.0])[:, np.newaxis, np.newaxis]
    covered = np.array([np.hypot(x - t * FAST[0], y - t * FAST[1]) < 20 for t in (0, 1)])
    ground = drifting_texture((0.0, 0.0), 2, SHAPE, seed=1)
    texture = np.where(covered, drifting_texture(FAST, 2, SHAPE), ground)
    light = (1 + 0.3 * texture / texture.std()).clip(0.05)
    level = level_of(np.random.default_rng(0).poisson(100 * light).astype(float))
    return level.roots.astype(np.float32), level.noise, covered


def at_nodes(inside):
    """Flow at nodes: fast where most of their pixels are inside."""
    most = to_nodes(inside[np.newaxis] * 1.0) > NODE_PX**2 / 2
    return np.where(most, np.reshape(FAST, (2, 1, 1)), 0.0)


def test_a_motion_known_in_the_middle_spreads_to_the_outline(disk):
    pair, noise, (covered, _) = disk
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] - 44.0
    flow, expected = at_nodes(np.hypot(x, y) < 12), at_nodes(covered)
    missed = (flow != expected).any(axis=0).sum()
    spread(pair, noise, flow)
    assert (flow != expected).any(axis=0).sum() < 0.5 * missed


def test_pixels_between_nodes_have_the_motion_of_their_side(disk):
    pair, noise, (covered, later) = disk
    nodes = at_nodes(covered)
    smooth, sharp = finer(nodes, SHAPE, NODE_PX), finer(nodes, SHAPE, NODE_PX)
    sharpen(pair, noise, nodes, sharp)
    truth, seen = np.where(covered, np.reshape(FAST, (2, 1, 1)), 0.0), covered | ~later
    before, after = (np.hypot(*(flow - truth))[seen].mean() for flow in (smooth, sharp))
    assert after < 0.6 * before
