import numpy as np
import pytest

from megalopta.assets_gen.plants.foliage import ATLAS_TILES, blades, leaf_axes, place_leaves
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


def test_blades_face_where_they_are_told():
    up = np.array([[0, 0, 1.0]])
    leaf = blades(
        0 * up,
        np.eye(3)[:1],
        up,
        np.ones(1),
        TREES["beech"].shape.foliage,
        np.random.default_rng(0),
    )
    assert np.all(leaf.to_mesh().face_normals[:, 2] > 0.9)


def test_the_twigs_bare_part_bears_nothing():
    axis = np.outer(np.linspace(0, 2, 5), [1.0, 0, 0])[None]
    bare = TREES["beech"].shape.foliage.model_copy(update={"bare": 0.4, "twigs": None})
    leaves = place_leaves(axis, bare, np.random.default_rng(0))
    assert leaves.vertices[::4, 0].min() >= 0.4 * 2


def test_each_leaf_shows_one_tile_of_the_atlas():
    leaves = place_leaves(AXES, TREES["beech"].shape.foliage, np.random.default_rng(0))
    tile = np.floor(leaves.uv.reshape(-1, 4, 2) * ATLAS_TILES)
    assert np.all(tile == tile[:, :1])
    assert len(np.unique(tile[:, 0], axis=0)) == ATLAS_TILES**2


def test_side_twigs_start_on_their_axis_and_bear_the_leaves():
    foliage = TREES["beech"].shape.foliage
    twigs = leaf_axes(AXES[:6], foliage, np.random.default_rng(0))
    # axes are sampled 400 times, as above
    assert distance_to_axes(twigs[:, 0], AXES[:6]).max() < 0.007
    lengths = np.linalg.norm(twigs[:, 1] - twigs[:, 0], axis=1)
    assert lengths.min() > 0 and lengths.max() <= 1.3 * foliage.twigs.length_m
