import numpy as np
import pytest

from megalopta.assets_gen.plants.forms import grow_axes
from megalopta.assets_gen.plants.skeleton import axes, pipe_areas, pipe_radii
from megalopta.scenes.forest.flora import TREES

DISUSED = 0.3


@pytest.fixture(
    params=[TREES["beech"].shape, TREES["spruce"].shape], ids=["beech", "spruce"], scope="module"
)
def skeleton(request):
    return grow_axes(request.param, np.random.default_rng(5)).skeleton


def descendants(skeleton, node):
    """Nodes above a node by a search that knows nothing of index order."""
    found, queue = [], [node]
    while queue:
        children = np.flatnonzero(skeleton.parents == queue.pop()).tolist()
        found += children
        queue += children
    return found


def test_pipe_area_is_the_tips_above_plus_shed_pipes_along_the_length_above(skeleton):
    areas = pipe_areas(skeleton, DISUSED)
    counts = skeleton.child_counts()
    for node in np.random.default_rng(0).choice(np.flatnonzero(counts), 40, replace=False):
        above = descendants(skeleton, node)
        tips = sum(counts[n] == 0 for n in above)
        steps = skeleton.positions[above] - skeleton.positions[skeleton.parents[above]]
        length = np.linalg.norm(steps, axis=1).sum()
        # float64 sums over a thousand internodes
        assert areas[node] == pytest.approx(tips + DISUSED * length, rel=1e-12)


def test_areas_above_a_fork_add_up_to_the_area_below_it_without_shed_pipes(skeleton):
    squares = pipe_radii(skeleton, 0.0, 0.1, 1.3) ** 2
    above = np.bincount(skeleton.parents[1:], squares[1:], len(squares))
    forks = skeleton.child_counts() > 1
    assert forks.sum() > 20
    np.testing.assert_allclose(above[forks], squares[forks], rtol=1e-12)


def test_the_stem_has_the_radius_asked_for_at_breast_height(skeleton):
    radii = pipe_radii(skeleton, DISUSED, 0.1, 1.3)
    stem = axes(skeleton, radii)[0]
    squared = np.interp(1.3, skeleton.positions[stem, 2], radii[stem] ** 2)
    assert np.sqrt(squared) == pytest.approx(0.1, rel=1e-12)
