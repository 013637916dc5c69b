"""Plants as they grow: skeletons, tubes, leaves, furrows."""

import numpy as np
import pytest

from megalopta.assets_gen import TEXTURES
from megalopta.assets_gen.plants.bark import CARVED_M, TILE_M, Furrows
from megalopta.assets_gen.plants.foliage import blades, place_leaves
from megalopta.assets_gen.plants.growth import grow_axes, grow_plant
from megalopta.assets_gen.plants.skeleton import (
    axes,
    pipe_areas,
    pipe_radii,
    rotation_minimizing_frames,
    swept_tube,
)
from megalopta.scenes.forest.flora import BUSHES, TREES

from ..conftest import welded

WOODY = {name: plant.shape for name, plant in {**TREES, **BUSHES}.items()}


@pytest.mark.parametrize("kind", WOODY)
def test_a_plant_has_its_height_stands_in_the_ground_and_consists_of_closed_tubes(kind):
    plant = grow_plant(WOODY[kind], np.random.default_rng(0))
    for surface in plant.tubes:
        mesh = welded(surface)
        assert mesh.is_watertight and mesh.is_winding_consistent
        assert mesh.volume > 0
    z = plant.branching.skeleton.positions[:, 2]
    assert z.max() == pytest.approx(WOODY[kind].height_m, rel=0.12)
    assert plant.wood.vertices[:, 2].min() < -0.3


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


def test_the_stem_has_the_radius_asked_for_at_breast_height(skeleton):
    radii = pipe_radii(skeleton, DISUSED, 0.1, 1.3)
    stem = axes(skeleton, radii)[0]
    squared = np.interp(1.3, skeleton.positions[stem, 2], radii[stem] ** 2)
    assert np.sqrt(squared) == pytest.approx(0.1, rel=1e-12)


def test_frames_on_a_helix_turn_back_by_its_torsion():
    # A helix of radius 1 and pitch 2πb has torsion b / (1 + b²); relative to the principal normal a
    # rotation-minimizing frame turns by minus the integral of the torsion over arc length.
    angle, b = np.linspace(0, 4 * np.pi, 4000), 0.3
    axis = np.stack([np.cos(angle), np.sin(angle), b * angle], axis=-1)
    tangents, normals, _ = rotation_minimizing_frames(axis)
    principal = -axis * (1, 1, 0)
    across = np.cross(tangents, principal)
    turn = np.unwrap(np.arctan2((normals * across).sum(1), (normals * principal).sum(1)))
    arc = 4 * np.pi * np.sqrt(1 + b**2)
    # second-order method: error falls with the square of the 4000 steps
    assert turn[-2] - turn[1] == pytest.approx(-arc * b / (1 + b**2), rel=2e-3)


def test_volume_is_that_of_a_prism_and_a_pyramid():
    radius, sides, axis = 0.3, 12, np.outer([0, 1, 2, 3.5], [0, 0, 1.0])
    tube = swept_tube(axis, np.full((3, sides), radius), TILE_M, np.zeros(2), whole_tiles=False)
    section = sides / 2 * radius**2 * np.sin(2 * np.pi / sides)
    assert welded(tube).volume == pytest.approx(section * (2 + 1.5 / 3), rel=1e-12)


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
    assert set(leaves.clusters) == {1, 2, 3, 4, 5, 6}
    for number, twig in enumerate(AXES[:6], start=1):
        mine = leaves.faces[leaves.clusters == number, 0]  # of both triangles, the base
        assert distance_to_axes(leaves.vertices[mine], twig[None]).max() < 0.007


def test_leaf_area_is_half_length_times_width_however_it_is_folded():
    sizes, foliage = np.array([0.5, 1.0, 2.0]), TREES["beech"].shape.foliage
    facing, rng = np.roll(np.eye(3), 1, axis=0), np.random.default_rng(0)
    leaf = blades(np.zeros((3, 3)), np.eye(3), facing, sizes, foliage, rng)
    area = leaf.to_mesh().area_faces.reshape(3, 2).sum(axis=1)
    np.testing.assert_allclose(area, sizes**2 * foliage.length_m * foliage.width_m / 2, rtol=1e-12)


RADIUS_M, DEPTH_M = 0.2, 0.02
AXIS = np.array([[0, 0, -0.35], [0, 0, 0], [0, 0, 0.5], [0.1, 0, 3], [0.1, 0, 6], [0.1, 0, 7]])
PROFILE = np.full((5, 12), RADIUS_M)
ORIGIN = np.array([0.3, 0.7])


@pytest.fixture(scope="module")
def furrows():
    return Furrows(TEXTURES["ridged"](np.random.default_rng(1)), DEPTH_M)


@pytest.fixture(scope="module")
def carved(furrows):
    return furrows.carved(AXIS, PROFILE, TILE_M, ORIGIN)


def test_a_carved_stem_keeps_its_mean_radius(carved):
    axis, profile = carved
    rough = (axis[:-1, 2] > 0) & (axis[:-1, 2] < CARVED_M[0])
    # Around 0.9 m² of bark with patches of half a meter the mean of a pattern varies by a tenth.
    assert profile[rough].mean() == pytest.approx(RADIUS_M, abs=0.1 * DEPTH_M)
    assert 0.05 * DEPTH_M < profile[rough].std() < 0.5 * DEPTH_M
    assert np.ptp(profile) <= DEPTH_M


def test_what_is_painted_dark_lies_deep(furrows, carved):
    axis, profile = carved
    surface = swept_tube(axis, profile, TILE_M, ORIGIN, whole_tiles=True)
    sides = profile.shape[1]
    uv = surface.uv[:-1].reshape(-1, sides + 1, 2)[:, :-1]
    rows, columns = furrows.pattern.shape
    row, column = (
        (uv[..., 1] * rows).astype(int) % rows,
        (uv[..., 0] * columns).astype(int) % columns,
    )
    rough = (axis[:-1, 2] > 0) & (axis[:-1, 2] < CARVED_M[0])
    paint = furrows.pattern[row, column][rough].ravel()
    # Grain finer than the mesh is painted only.
    assert np.corrcoef(paint, -profile[rough].ravel())[0, 1] > 0.7
