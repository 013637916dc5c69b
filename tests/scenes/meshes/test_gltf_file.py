"""Compressed and sparse data of glTF files, against the same data as they were before."""

import meshopt
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from megalopta.scenes.meshes.gltf import pieces_of

from .files import Gltf

BALL = trimesh.creation.icosphere(2)
UV = np.random.default_rng(2).random((len(BALL.vertices), 2)).astype(np.float32)


def ball():
    """A ball with coordinates that are different at every vertex."""
    file = Gltf()
    vertices = BALL.vertices.astype(np.float32)
    given = {"TEXCOORD_0": file.accessor(UV), "NORMAL": file.accessor(vertices)}
    file.triangle(vertices, 0, BALL.faces, **given)
    file.header["materials"] = [{"name": "paint"}]
    return file


def read(file):
    (piece,) = pieces_of({"a.glb": file.glb()})
    return piece


def assert_is_the_ball(piece, within):
    """Every vertex has its coordinates and normal, and triangles connect the same ones."""
    vertex = cKDTree(BALL.vertices).query(piece.vertices)[1]
    np.testing.assert_allclose(piece.vertices, BALL.vertices[vertex], atol=within)
    np.testing.assert_allclose(piece.uv, np.stack([UV[:, 0], 1 - UV[:, 1]], axis=1)[vertex])
    np.testing.assert_allclose(piece.normals, BALL.vertices[vertex], atol=50 * within)
    assert sorted(map(sorted, vertex[piece.faces])) == sorted(map(sorted, BALL.faces))


@pytest.mark.parametrize("preserve_order", [True, False])
def test_what_draco_compresses_is_what_it_was(preserve_order):
    file = ball()
    file.with_draco(preserve_order=preserve_order)
    assert_is_the_ball(read(file), 2e-5)  # 16 bits for a diameter of 2


def test_what_meshopt_compresses_is_what_it_was():
    file = ball()
    part = file.header["meshes"][0]["primitives"][0]
    of = part["attributes"]
    file.with_meshopt(part["indices"], "TRIANGLES")
    file.with_meshopt(of["TEXCOORD_0"], "ATTRIBUTES")
    rows = np.zeros((len(UV), 4), np.int16)
    rows[:, :3] = np.rint(BALL.vertices * 32767)
    file.with_meshopt(of["POSITION"], "ATTRIBUTES", rows)
    file.header["accessors"][of["POSITION"]] |= {"componentType": 5122, "normalized": True}
    turned = np.pad(BALL.vertices, ((0, 0), (0, 1)))
    octahedral = meshopt.encode_filter_oct(turned, 8, 12)
    file.with_meshopt(of["NORMAL"], "ATTRIBUTES", octahedral.reshape(-1, 8), "OCTAHEDRAL")
    file.header["accessors"][of["NORMAL"]] |= {"componentType": 5122, "normalized": True}
    assert_is_the_ball(read(file), 2e-5)


def test_triangles_of_meshoptimizers_own_tests():
    """Bytes and indices of its repository (demo/tests.cpp, version 0 of the format)."""
    packed = bytes.fromhex("e0f010fefff00cff020202007687566778a9866589689801690000")
    triangles = [0, 1, 2, 2, 1, 3, 4, 6, 5, 7, 8, 9]
    file = Gltf()
    vertices = np.random.default_rng(0).random((10, 3)).astype(np.float32)
    file.triangle(vertices, faces=triangles)
    file.with_meshopt(len(file.header["accessors"]) - 1, "TRIANGLES")
    view = file.header["bufferViews"][-1]["extensions"]["EXT_meshopt_compression"]
    view |= file.header["bufferViews"][file.view(packed)]
    assert read(file).faces.ravel().tolist() == triangles


def test_values_of_sparse_accessors_replace_others():
    file = Gltf()
    file.triangle(np.zeros((3, 3), np.float32))
    indices, values = file.view(np.uint16([1, 2]).tobytes()), np.float32([[1, 0, 0], [0, 5, 0]])
    file.header["accessors"][0]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": indices, "componentType": 5123},
        "values": {"bufferView": file.view(values.tobytes())},
    }
    np.testing.assert_array_equal(read(file).vertices, [[0, 0, 0], *values])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda header: header["accessors"][-1].update(count=957), "hold 320 triangles, not 319"),
        (lambda header: header["accessors"][0].update(count=161), "decodes of TEXCOORD_0"),
        (lambda header: header["bufferViews"][-1].update(byteLength=40), "Draco|draco"),
        (lambda header: header["bufferViews"][-1].update(byteOffset=4), "no mesh of version 2.2"),
    ],
)
def test_draco_that_is_not_what_the_file_states_is_refused(change, reason):
    file = ball()
    file.with_draco(preserve_order=True)
    change(file.header)
    with pytest.raises(Exception, match=reason):
        read(file)


def test_a_view_that_unpacks_to_another_size_is_refused_before_it_is_unpacked():
    for change in ({"count": 10**9}, {"byteStride": 4}):
        file = ball()
        file.with_meshopt(0, "ATTRIBUTES")
        file.header["bufferViews"][-1]["extensions"]["EXT_meshopt_compression"] |= change
        with pytest.raises(ValueError, match=r"bufferViews.* unpacks to differ in size"):
            read(file)
    file.header["bufferViews"][-1] |= {"byteLength": 8 * 10**9}
    packed = file.header["bufferViews"][-1]["extensions"]["EXT_meshopt_compression"]
    packed |= {"count": 10**9, "byteStride": 8}
    file.header["bufferViews"][-1]["byteStride"] = 8
    with pytest.raises(ValueError, match="takes 24 GB"):
        read(file)
