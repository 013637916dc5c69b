import numpy as np
import pytest

from megalopta.assets_gen.plants.foliage import blades, place_leaves
from megalopta.scenes.forest.flora import TREES

AXES = np.random.default_rng(3).normal(0, 1, (40, 3, 3))


def distance_to_axes(points, axes):
    """Least distance from each point to any segment, by sampling each segment finely."""
    share = np.linspace(0, 1, 400)[:, None]
    samples = axes[:, :-1, None] + share * np.diff(axes, axis=1)[:, :, None]
    gaps = points[:, None] - samples.reshape(1, -1, 3)
    return np.linalg.norm(gaps, axis=-1).min(axis=1)


@pytest.mark.parametrize(
    "foliage",
    [TREES["beech"].shape.foliage, TREES["spruce"].shape.foliage],
    ids=["leaf", "needles"],
)
def test_every_leaf_starts_on_its_twig(foliage):
    leaves = place_leaves(AXES[:6], foliage, np.random.default_rng(0))
    # twigs of up to 5 m sampled 400 times: samples are 12 mm apart, so 6 mm from any point
    assert distance_to_axes(leaves.vertices[::4], AXES[:6]).max() < 0.007


def test_leaf_area_is_half_length_times_width_however_it_is_folded():
    sizes = np.array([0.5, 1.0, 2.0])
    leaf = blades(
        np.zeros((3, 3)),
        np.eye(3),
        np.roll(np.eye(3), 1, axis=0),
        sizes,
        TREES["beech"].shape.foliage,
        np.random.default_rng(0),
    )
    area = leaf.to_mesh().area_faces.reshape(3, 2).sum(axis=1)
    expected = (
        sizes**2 * TREES["beech"].shape.foliage.length_m * TREES["beech"].shape.foliage.width_m / 2
    )
    np.testing.assert_allclose(area, expected, rtol=1e-12)
