import numpy as np
import pytest
from pydantic import ValidationError

from megalopta.scenes.motion import Tour
from megalopta.scenes.moving_objects import MovingObject, with_objects
from megalopta.scenes.scene import Scene

EMPTY = Scene({}, {}, ())


def test_objects_stand_where_they_are_put_and_turn_as_told():
    thing = MovingObject(size_m=(4, 2, 1), position_m=(10, 20, 30), turn_deg=(0, 0, 90))
    scene = with_objects(EMPTY, (thing,))
    (placement,) = scene.placements
    (mesh,) = scene.assets[placement.asset].parts.values()
    corners = mesh.vertices @ placement.to_world[:3, :3].T + placement.to_world[:3, 3]
    np.testing.assert_allclose(corners.min(axis=0), [9, 18, 29.5], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [11, 22, 30.5], atol=1e-12)
    assert placement.motion is None


def test_an_object_spins_about_its_own_center_while_it_drifts():
    thing = MovingObject.model_validate(
        {"position_m": (1, 2, 3), "motion": {"velocity_m_s": (1, 0, -1), "spin_deg_s": 90}}
    )
    motion = with_objects(EMPTY, (thing,)).placements[0].motion
    center, corner = motion.carry(np.array([[1.0, 2, 3], [2, 2, 3]]), 1.0)
    np.testing.assert_allclose(center, [2, 2, 2], atol=1e-12)
    np.testing.assert_allclose(corner, [2, 3, 2], atol=1e-12)  # +x has become +y


def test_a_tour_passes_its_ways_and_rests_at_its_ends():
    ways = ((0.0, 0.0, 0.0), (1.0, 2.0, 0.0), (3.0, 1.0, 1.0))
    tour = Tour(times_s=(1, 2, 4), ways_m=ways)
    for time, way in zip((0, 1, 2, 4, 9), (ways[0], *ways, ways[2]), strict=True):
        np.testing.assert_allclose(tour.shift(time), way, atol=1e-12)
    np.testing.assert_allclose(tour.shift(1 + 1e-6), 0, atol=1e-10)  # sets off from rest


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (
            {"kind": "spline", "times_s": (0, 1), "ways_m": ((0, 0, 0),) * 3},
            "2 entries and ways_m 3",
        ),
        ({"kind": "spline", "times_s": (1, 1), "ways_m": ((0, 0, 0),) * 2}, "does not grow"),
        ({"spin_axis": (0, 0, 0)}, "spin_axis .* has no direction"),
    ],
)
def test_a_motion_that_makes_no_sense_is_refused(motion, words):
    with pytest.raises(ValidationError, match=words):
        MovingObject.model_validate({"motion": motion})
