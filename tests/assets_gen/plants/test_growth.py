import numpy as np
import pytest

from megalopta.assets_gen.plants.growth import grow_plant
from megalopta.assets_gen.plants.skeleton import axes
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


def test_every_axis_is_a_closed_tube_with_its_outside_out(plant):
    for surface in plant.tubes:
        mesh = welded(surface)
        assert mesh.is_watertight and mesh.is_winding_consistent
        assert mesh.volume > 0


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
