import numpy as np
import pytest
from scipy.spatial import cKDTree

from megalopta.assets_gen.plants.branching import (
    KILL_STEPS,
    MAX_CHILDREN,
    colonize,
    crown_points,
)
from megalopta.assets_gen.plants.skeleton import Skeleton
from megalopta.scenes.forest.flora import TREES

STEP_M = 0.4


@pytest.fixture(scope="module")
def points():
    return crown_points(
        TREES["beech"].shape.crown, TREES["beech"].shape.height_m, 200, np.random.default_rng(1)
    )


@pytest.fixture(scope="module")
def grown(points):
    trunk = np.outer(np.linspace(0, 3, 9), [0, 0, 1.0])
    start = Skeleton(trunk, np.arange(-1, 8))
    return colonize(start, np.array([8]), points, STEP_M, 0.1, np.random.default_rng(2))


def test_attraction_points_lie_in_the_crown(points):
    level = (points[:, 2] / TREES["beech"].shape.height_m - TREES["beech"].shape.crown.base) / (
        1 - TREES["beech"].shape.crown.base
    )
    assert level.min() >= 0 and level.max() <= 1
    # 1.28: the crown's radius times the largest possible sum of its two lobes
    assert np.hypot(*points[:, :2].T).max() <= 1.28 * TREES["beech"].shape.crown.radius_m


def test_branches_come_close_to_nearly_all_attraction_points(grown, points):
    distance, _ = cKDTree(grown.positions).query(points)
    assert np.mean(distance <= KILL_STEPS * STEP_M) > 0.95


def test_every_new_internode_is_one_step_long(grown):
    length = np.linalg.norm(grown.internodes()[9:], axis=1)
    np.testing.assert_allclose(length, STEP_M, rtol=1e-12)


def test_only_buds_grow_and_forks_are_limited(grown):
    counts = grown.child_counts()
    assert counts[:8].max() == 1
    assert counts.max() <= MAX_CHILDREN
