"""Animation against the formulas of the specification, written here again."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from megalopta.scenes import Light, Meshes, PerspectiveCamera, Trajectory
from megalopta.scenes.meshes.animation import Track
from megalopta.scenes.meshes.gltf import pieces_of

from .files import Gltf, pose

KEYS = np.array([0.5, 1.0, 2.5], np.float32)
TIMES = np.array([0.0, 0.5, 0.6, 0.99, 1.0, 1.7, 2.5, 9.0])
RNG = np.random.default_rng(8)


def spline(values, key, share, span):
    """The specification's sum; values are (3, 3, d): key; slope before, value, slope after."""
    (_, first, leaving), (arriving, second, _) = values[key], values[key + 1]
    return (
        (2 * share**3 - 3 * share**2 + 1) * first
        + span * (share**3 - 2 * share**2 + share) * leaving
        + (-2 * share**3 + 3 * share**2) * second
        + span * (share**3 - share**2) * arriving
    )


@pytest.mark.parametrize(
    ("mode", "shape", "formula"),
    [
        ("STEP", (3, 2), lambda v, key, share, _: v[key + (share == 1)]),
        ("LINEAR", (3, 3), lambda v, key, share, _: (1 - share) * v[key] + share * v[key + 1]),
        ("CUBICSPLINE", (3, 3, 4), spline),
    ],
)
def test_values_between_keys_follow_the_formulas_of_the_specification(mode, shape, formula):
    values = RNG.normal(size=shape)
    for time, found in zip(TIMES, Track(KEYS, values, mode).at(TIMES, False), strict=True):
        x = np.clip(time, 0.5, 2.5)
        key, span = (0, 0.5) if x < 1 else (1, 1.5)
        expected = formula(values, key, (x - KEYS[key]) / span, span)
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_rotations_turn_at_constant_speed_the_shorter_way():
    first, second = Rotation.random(2, random_state=3)
    quaternions = np.array([first.as_quat(), -second.as_quat()])
    half = Track(np.array([0.0, 2.0]), quaternions).at(np.array([0.5]), True)
    way = (second * first.inv()).as_rotvec()
    expected = Rotation.from_rotvec(0.25 * way) * first
    np.testing.assert_allclose(Rotation.from_quat(half).as_matrix()[0], expected.as_matrix())


TURNS = Rotation.from_euler("z", [[0], [90], [200]], degrees=True).as_quat().astype(np.float32)
SHIFTS = np.array([[0, 0, 0], [1, 2, 3], [0, -1, 0]], np.float32)


def mill(**changes):
    """A wheel that turns below a mast, whose blade slides along; the mast is stretched."""
    file = Gltf()
    file.triangle(NORMAL=file.accessor(np.float32([[0, 0, 1]] * 3)))
    file.header["nodes"] = [
        {"name": "mast", "children": [1], "scale": [1, 2, 1], "translation": [0, 0, 1]},
        {"name": "wheel", "children": [2], "translation": [1, 0, 0]},
        {"name": "blade", "mesh": 0, "translation": [3, 0, 0], "rotation": [0.6, 0, 0, 0.8]},
        {"name": "still", "mesh": 0},
    ]
    ways = (1, "rotation", TURNS), (2, "translation", SHIFTS), (2, "pointer", SHIFTS)
    file.animate(KEYS, *ways)
    file.header |= changes
    return file


def world(time_s):
    """Pose of the blade at a time between the keys, by hand."""
    x = np.clip(time_s, 0.5, 2.5)
    angle = np.interp(x, KEYS, [0, 90, 200])
    slide = np.array([np.interp(x, KEYS, each) for each in SHIFTS.T])
    mast = pose(shift=(0, 0, 1)) @ np.diag([1, 2, 1, 1.0])
    wheel = pose(angle, (0, 0, 1), (1, 0, 0))
    blade = pose(2 * np.degrees(np.arctan2(0.6, 0.8)), (1, 0, 0), slide)
    return mast @ wheel @ blade


@pytest.fixture
def blade():
    return next(
        each for each in pieces_of({"a.glb": mill().glb()}, ["animation"]) if each.name == "blade"
    )


def test_a_node_moves_with_all_above_it(blade):
    local = np.array([[0, 0, 0, 1], [1, 0, 0, 1], [0, 1, 0, 1.0]])
    for time in TIMES:
        expected = (local @ world(time).T)[:, :3]
        np.testing.assert_allclose(blade.motion.carry(blade.vertices, time), expected, atol=1e-6)


def test_points_at_their_own_times_go_as_one_by_one_and_back(blade):
    points = RNG.normal(size=(len(TIMES), 3))
    together = blade.motion.carry(points, TIMES)
    for point, time, found in zip(points, TIMES, together, strict=True):
        np.testing.assert_allclose(found, blade.motion.carry(point[None], time)[0])
        np.testing.assert_allclose(blade.motion.undo(found[None], time)[0], point, atol=1e-9)


def test_normals_stay_at_right_angles_to_the_surface(blade):
    flat = blade.sound()
    for time in TIMES:
        a, b, c = blade.motion.carry(flat.vertices, time)
        (normal, *_) = blade.motion.turn(flat.normals, flat.vertices, time)
        facing = np.cross(b - a, c - a)
        np.testing.assert_allclose(normal, facing / np.linalg.norm(facing), atol=1e-6)


def test_what_does_not_move_has_no_motion_and_without_animation_nothing_has():
    moving = {
        piece.name: piece.motion for piece in pieces_of({"a.glb": mill().glb()}, ["animation"])
    }
    assert moving["still"] is None and moving["blade"] is not None
    assert all(piece.motion is None for piece in pieces_of({"a.glb": mill().glb()}))
    with pytest.raises(ValueError, match="no animation of nodes with meshes.*; omit animate"):
        list(pieces_of({"a.glb": mill(animations=[]).glb()}, ["animation"]))


def test_what_of_an_animation_has_no_effect_is_told(tmp_path):
    (tmp_path / "a.glb").write_bytes(mill().glb())
    description = Meshes(files=({"file": str(tmp_path / "a.glb"), "animate": True},))
    notes = " ".join(description.build(Light(), PerspectiveCamera(), Trajectory()).notes)
    assert "an animation's extensions (pointer)" in notes
