import numpy as np
import pytest
from scipy.spatial import cKDTree

from megalopta.assets_gen.plants.growth import grow_plant, simplified
from megalopta.assets_gen.plants.skeleton import axes
from megalopta.assets_gen.plants.species import aged
from megalopta.scenes.forest.flora import BUSHES, TREES

from ..conftest import welded

WOODY = {name: plant.shape for name, plant in {**TREES, **BUSHES}.items()}


def grow(species, individual=0):
    return grow_plant(species, np.random.default_rng(individual))


@pytest.fixture(params=WOODY, scope="module")
def kind(request):
    return request.param


@pytest.fixture(scope="module")
def plant(kind):
    return grow(WOODY[kind])


def bytes_of(plant):
    wood, leaves = plant.wood, plant.leaves
    arrays = (wood.vertices, wood.faces, wood.uv, wood.normals)
    return b"".join(a.tobytes() for a in (*arrays, leaves.vertices, leaves.faces, leaves.uv))


def test_same_random_stream_grows_the_same_bytes(kind, plant):
    assert bytes_of(grow(WOODY[kind])) == bytes_of(plant)


def test_individuals_differ(kind, plant):
    assert bytes_of(grow(WOODY[kind], 1)) != bytes_of(plant)


def test_every_axis_is_a_closed_tube_with_its_outside_out(plant):
    for surface in plant.tubes:
        mesh = welded(surface)
        assert mesh.is_watertight and mesh.is_winding_consistent
        assert mesh.volume > 0


def test_triangles_stay_within_budget(kind, plant):
    assert len(plant.wood.faces) < (6000 if kind in TREES else 2000)
    assert len(plant.leaves.faces) < (100_000 if kind in TREES else 12_000)


def test_every_leaf_is_attached_to_a_bearing_twig(plant):
    axes = plant.twigs
    share = np.linspace(0, 1, 60)[:, None]
    along = (axes[:, :-1, None] + share * np.diff(axes, axis=1)[:, :, None]).reshape(-1, 3)
    base = plant.leaves.vertices[::4][::7]
    gap, _ = cKDTree(along).query(base)
    # internodes are at most 0.7 m: samples are 12 mm apart
    assert gap.max() < 0.007


def test_the_plant_has_its_height_and_stands_in_the_ground(kind, plant):
    z = plant.branching.skeleton.positions[:, 2]
    assert z.max() == pytest.approx(WOODY[kind].height_m, rel=0.12)
    assert plant.wood.vertices[:, 2].min() < -0.3


def test_wood_is_a_tenth_to_a_third_of_a_tree_s_area(kind, plant):
    # Half of its surface; stands, whose trees lose some leaves, are held to field values elsewhere.
    wood = plant.wood.area / 2
    assert kind not in TREES or 0.05 < wood / (wood + plant.leaves.area) < 1 / 3


def test_a_fuller_plant_has_more_leaves_on_the_same_wood(kind, plant):
    full = grow_plant(WOODY[kind], np.random.default_rng(0), 2.0)
    assert np.array_equal(full.wood.vertices, plant.wood.vertices)
    assert full.leaves.area == pytest.approx(2 * plant.leaves.area, rel=0.3)


def test_the_young_are_lower_and_thinner():
    young = aged(WOODY["oak"], 0.5)
    assert grow(young).wood.vertices[:, 2].max() < 0.6 * WOODY["oak"].height_m
    assert young.radius_m < 0.5 * WOODY["oak"].radius_m
    assert aged(WOODY["oak"], 1.0) == WOODY["oak"]


def test_buttresses_widen_the_foot_alone():
    bare = grow(WOODY["kapok"].model_copy(update={"buttresses": None}))
    walled = grow(WOODY["kapok"])
    tops = [plant.tubes[0].vertices for plant in (bare, walled)]
    feet = [np.hypot(*v[v[:, 2] < 0.6].T[:2]).max() for v in tops]
    assert feet[1] > 2 * feet[0]
    # e^-6 of a reach of five radii is left eight meters up
    high = [v[v[:, 2] > 8] for v in tops]
    assert np.ptp(high[1], axis=0)[0] == pytest.approx(np.ptp(high[0], axis=0)[0], rel=0.1)


def test_thin_tubes_of_three_sides_are_as_wide_on_average_as_the_branch_they_stand_for(plant):
    nodes = axes(plant.branching.skeleton, plant.radii_m)
    for axis, tube in zip(nodes, plant.tubes, strict=True):
        points, radii = plant.branching.skeleton.positions[axis], plant.radii_m[axis]
        if len(axis) == 2 and plant.branching.skeleton.parents[axis[0]] >= 0:
            sides = (len(tube.vertices) - 1) - 1
            ring = tube.vertices[:sides] - points[0]
            around = np.linalg.norm(np.diff(ring, axis=0, append=ring[:1]), axis=1).sum()
            # Cauchy: the mean width of a convex outline is its circumference over pi
            assert around / np.pi == pytest.approx(2 * radii[1], rel=1e-9)


def test_simplified_polyline_stays_within_tolerance():
    t = np.linspace(0, 3, 80)
    points = np.stack([t, np.sin(2 * t)], axis=-1)
    kept = simplified(points, 0.05)
    assert 4 < len(kept) < 20
    between = np.interp(t, t[kept], points[kept, 1])
    # the vertical gap bounds the distance to the chord from above
    slope = np.sqrt(1 + 2**2)
    assert np.abs(between - points[:, 1]).max() <= 0.05 * slope
