from dataclasses import replace

import numpy as np
import pytest
import trimesh

from megalopta.render.loading.meshes import MovingMesh, merge
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.motion import Drift, RigidMotion
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat

BOX = trimesh.creation.box((1, 2, 3))
BALL = trimesh.creation.icosphere(2)


def turned(angle, scale, shift):
    pose = trimesh.transformations.rotation_matrix(angle, (1, 2, 3))
    pose[:3, :3] *= scale
    pose[:3, 3] = shift
    return pose


def scene(texture=None):
    return Scene(
        {"wood": Material(flat(0.3), texture), "leaf": Material(flat(0.1))},
        {"tree": Asset({"wood": BOX, "leaf": BALL}), "log": Asset({"wood": BOX})},
        (
            Placement("tree", "beech", turned(0.4, 2.0, (5, 0, 0))),
            Placement("log", "log", turned(1.4, 0.5, (-5, 0, 0))),
            Placement("tree", "beech", turned(2.4, 1.0, (0, 5, 0))),
        ),
    )


def test_merging_conserves_the_volume_of_every_object():
    wood = next(mesh for mesh in merge(scene()) if mesh.material == "wood")
    for object_id, scale in ((1, 2.0), (2, 0.5), (3, 1.0)):
        faces = wood.faces[wood.object_id == object_id]
        volume = trimesh.Trimesh(wood.vertices, faces, process=False).volume
        assert volume == pytest.approx(6 * scale**3, rel=1e-5)


def test_smooth_normals_turn_with_their_object():
    ball = BALL.copy()
    ball.metadata["smooth"] = True
    pose = turned(0.7, 2.0, (1, 2, 3))
    one = Scene(
        {"m": Material(flat(0.5))}, {"ball": Asset({"m": ball})}, (Placement("ball", "ball", pose),)
    )
    (mesh,) = merge(one)
    radial = (mesh.vertices - pose[:3, 3]) / 2.0
    np.testing.assert_allclose(mesh.normals, radial, atol=0.02)  # a subdivided sphere
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, rtol=1e-6)


def test_a_textured_material_needs_uv():
    texture = Texture(np.zeros((2, 2), np.float32), flat(0.5))
    with pytest.raises(ValueError, match="'wood' is patterned, but its mesh has no uv"):
        merge(scene(texture))


def test_what_moves_comes_last_and_is_where_its_motion_takes_it():
    pivot = (5.0, 0.0, 0.0)
    motion = RigidMotion(pivot, Drift(velocity_m_s=(1, 2, 3), spin_deg_s=90))
    still = scene()
    moving = replace(
        still,
        placements=(replace(still.placements[0], motion=motion), *still.placements[1:]),
        origin_m=(4.0, 0.0, 0.0),
    )
    meshes = merge(moving)
    assert [isinstance(mesh, MovingMesh) for mesh in meshes] == [False, False, True, True]
    assert sum(len(mesh.faces) for mesh in meshes) == still.triangle_count
    wood = meshes[-1]
    at_rest = BOX.vertices @ still.placements[0].to_world[:3, :3].T
    np.testing.assert_allclose(wood.vertices, np.add(at_rest, (1, 0, 0)), atol=1e-6)
    # A quarter turn about z, then a second of drift, about the local origin.
    turned = at_rest[:, [1, 0, 2]] * [-1, 1, 1]
    np.testing.assert_allclose(wood.vertices_at(1.0), np.add(turned, (2, 2, 3)), atol=1e-5)
    np.testing.assert_array_equal(wood.vertices_at(0.0), wood.vertices)
    assert (wood.object_id == 1).all()
