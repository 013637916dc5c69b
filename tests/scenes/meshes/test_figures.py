"""Skinned and morphed figures against the sums of the specification, written here vertex by vertex."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from megalopta.scenes.meshes.gltf import pieces_of

from .files import Gltf, pose

KEYS = np.array([0.0, 0.5, 2.0], np.float32)
ANGLES_DEG = np.array([0.0, 50.0, -30.0])
SHARES = np.array([[0, 1], [0.5, 0], [1, 0.25]], np.float32)
TUBE = trimesh.creation.cylinder(0.2, 2.0, sections=8).subdivide()
AWAY = np.random.default_rng(5).normal(scale=0.1, size=(2, *TUBE.vertices.shape)).astype(np.float32)
SWAP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])  # length along y
BENT = (TUBE.vertices @ SWAP.T).astype(np.float32)
UPPER = np.clip(BENT[:, 1] / 2 + 0.5, 0, 1).astype(np.float32)
WEIGHTS = np.stack([1 - UPPER, UPPER, 0 * UPPER, 0 * UPPER], axis=1)
JOINTS = np.tile(np.array([0, 1, 0, 0], np.uint8), (len(UPPER), 1))


def arm(is_skin=True, has_shapes=True):
    """A tube whose upper part a joint bends, in a mesh of two shapes."""
    file = Gltf()
    skin = {"JOINTS_0": file.accessor(JOINTS), "WEIGHTS_0": file.accessor(WEIGHTS)}
    normals = file.accessor(TUBE.vertex_normals.astype(np.float32) @ SWAP.T.astype(np.float32))
    file.triangle(BENT, None, TUBE.faces, NORMAL=normals, **(skin if is_skin else {}))
    if has_shapes:
        (part,) = file.header["meshes"][0]["primitives"]
        part["targets"] = [{"POSITION": file.accessor(away)} for away in AWAY]
        file.header["meshes"][0]["weights"] = [0.5, 0.5]
    inverse = np.stack([np.linalg.inv(bind) for bind in BIND]).swapaxes(1, 2)
    matrices = file.accessor(inverse.reshape(2, 16).astype(np.float32))
    file.header["skins"] = [{"joints": [2, 3], "inverseBindMatrices": matrices}]
    file.header["nodes"] = [
        {"name": "arm", "mesh": 0, **({"skin": 0} if is_skin else {}), "translation": [9, 0, 0]},
        {"name": "body", "children": [2], "translation": [0, 1, 0], "scale": [1, 2, 1]},
        {"name": "shoulder", "children": [3]},
        {"name": "elbow", "translation": [0, 0.1, 0]},
    ]
    turns = Rotation.from_euler("x", ANGLES_DEG[:, None], degrees=True).as_quat()
    bends, shifts = [(3, "rotation", turns)], [(0, "weights", SHARES.ravel())]
    file.animate(KEYS, *bends * is_skin, *shifts * has_shapes)
    return file


BIND = [pose(shift=(0, -1, 0)), pose(shift=(0, 0.2, 0))]


def bent(time_s, is_skin=True, has_shapes=True):
    """Vertices at a time, by hand; without a time as the file poses them."""
    angle = 0.0 if time_s is None else np.interp(time_s, KEYS, ANGLES_DEG)
    shares = np.array([np.interp(time_s or 0, KEYS, share) for share in SHARES.T])
    shares = np.array([0.5, 0.5]) if time_s is None else shares
    body = pose(shift=(0, 1, 0)) @ np.diag([1, 2, 1, 1.0])
    joints = [body, body @ pose(angle, (1, 0, 0), (0, 0.1, 0))]
    places = []
    for vertex, weights, *away in zip(BENT, WEIGHTS, *AWAY, strict=True):
        point = vertex + has_shapes * (shares @ np.array(away))
        if is_skin:
            bones = [joint @ np.linalg.inv(bind) for joint, bind in zip(joints, BIND, strict=True)]
            bone = weights[0] * bones[0] + weights[1] * bones[1]
        else:
            bone = pose(shift=(9, 0, 0))
        places.append((bone @ [*point, 1])[:3])
    return np.array(places)


KINDS = [(True, True), (True, False), (False, True)]


def read(file, *used):
    return list(pieces_of({"a.glb": file.glb()}, used))


@pytest.mark.parametrize(("is_skin", "has_shapes"), KINDS)
def test_vertices_follow_their_bones_and_shapes(is_skin, has_shapes):
    file = arm(is_skin, has_shapes)
    (still,), (moving,) = read(file), read(file, "animation")
    assert still.motion is None
    np.testing.assert_allclose(still.vertices, bent(None, is_skin, has_shapes), atol=1e-6)
    elsewhere = pose(30, (1, 2, 3), (4, 5, 6), 2.0)
    moved = moving.moved(elsewhere)
    times = np.array([0.0, 0.3, 1.1, 9.0])
    for time in times:
        expected = bent(min(time, 2.0), is_skin, has_shapes) @ elsewhere[:3, :3].T
        places = moved.motion.carry(moved.vertices, time)
        np.testing.assert_allclose(places, expected + elsewhere[:3, 3], atol=2e-6)
        some = np.arange(0, len(BENT), 7)
        mixed = moved.motion.carry(moved.vertices[some], np.full(len(some), time))
        np.testing.assert_allclose(mixed, places[some], atol=1e-12)


def test_normals_turn_with_the_bone_that_holds_them():
    (piece,) = (moving.sound() for moving in read(arm(has_shapes=False), "animation"))
    held, body = UPPER == 1, np.diag([1, 2, 1])
    for time in (0.0, 0.4, 2.0):
        bone = body @ pose(np.interp(time, KEYS, ANGLES_DEG), (1, 0, 0))[:3, :3]
        normals = TUBE.vertex_normals[held] @ SWAP.T @ np.linalg.inv(bone)
        expected = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        turned = piece.motion.turn(piece.normals, piece.vertices, time)
        np.testing.assert_allclose(turned[held], expected, atol=1e-5)


def test_vertices_at_one_place_part_with_their_bones():
    file = Gltf()
    twice = np.tile(np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), (2, 1))
    joints = np.repeat(np.array([[0, 0, 0, 0], [1, 0, 0, 0]], np.uint8), 3, axis=0)
    weights = np.tile(np.float32([[1, 0, 0, 0]]), (6, 1))
    file.triangle(twice, JOINTS_0=file.accessor(joints), WEIGHTS_0=file.accessor(weights))
    file.header["skins"] = [{"joints": [1, 2]}]
    file.header["nodes"] = [{"mesh": 0, "skin": 0}, {}, {}]
    file.animate([0, 1], (2, "translation", [[0, 0, 0], [0, 0, 5]]))
    (piece,) = read(file, "animation")
    places = piece.motion.carry(piece.vertices, 1.0)
    np.testing.assert_allclose(places[:3], twice[:3])
    np.testing.assert_allclose(places[3:], twice[3:] + np.array([0, 0, 5]))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda file: file.header.pop("animations"), "no animation of nodes with meshes"),
        (lambda file: file.header["skins"][0].update(joints=[2]), "joints that are not there"),
        (lambda file: file.header["skins"][0].update(joints=[2] * 1001), "1,001 joints of a skin"),
    ],
)
def test_figures_that_do_not_move_or_have_no_bones_are_refused(change, reason):
    file = arm()
    change(file)
    with pytest.raises(ValueError, match=reason):
        read(file, "animation")
