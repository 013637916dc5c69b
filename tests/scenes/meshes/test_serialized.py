"""Serialized files against Mitsuba's own reader."""

import struct
import zlib

import mitsuba as mi
import numpy as np
import pytest
import trimesh

from megalopta.scenes.meshes.model import PlacedMesh
from megalopta.scenes.meshes.serialized import pieces_of

BALL = trimesh.creation.icosphere(1)


def packed(vertices, faces, name="", kind="<f4", flags=0, **columns):
    """A shape of version 4."""
    bits = {"normals": 1, "uv": 2, "colors": 8}
    flags |= (0x1000 if kind == "<f4" else 0x2000) + sum(bits[column] for column in columns)
    data = struct.pack("<I", flags) + name.encode() + b"\0"
    data += struct.pack("<2Q", len(vertices), len(faces))
    data += b"".join(np.asarray(part, kind).tobytes() for part in (vertices, *columns.values()))
    return struct.pack("<2H", 0x041C, 4) + zlib.compress(data + np.asarray(faces, "<u4").tobytes())


def file_of(*shapes):
    places = np.cumsum([0, *map(len, shapes)])[:-1]
    return b"".join(shapes) + places.astype("<u8").tobytes() + struct.pack("<I", len(shapes))


UV = np.random.default_rng(3).random((len(BALL.vertices), 2))
SHAPES = (
    packed(BALL.vertices, BALL.faces, "ball", normals=BALL.vertices, uv=UV),
    packed(2 * BALL.vertices, BALL.faces[5:], kind="<f8", uv=UV),
    packed(3 * BALL.vertices, BALL.faces, "c", flags=0x10, uv=UV, colors=BALL.vertices),
)


def test_shapes_are_those_of_mitsubas_own_reader(tmp_path):
    path = tmp_path / "a.serialized"
    path.write_bytes(file_of(*SHAPES))
    pieces = list(pieces_of({"a.serialized": path.read_bytes()}))
    assert [piece.name for piece in pieces] == ["ball", "a", "c"]
    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    for number, piece in enumerate(pieces):
        given = {"type": "serialized", "filename": str(path), "shape_index": number}
        theirs = mi.traverse(mi.load_dict(given))
        for name, values in (("positions", piece.vertices), ("texcoords", piece.uv)):
            np.testing.assert_allclose(theirs[f"vertex_{name}"], values.ravel(), rtol=1e-6)
        np.testing.assert_array_equal(theirs["faces"], piece.faces.ravel())
        if number == 0:
            np.testing.assert_allclose(theirs["vertex_normals"], piece.normals.ravel(), rtol=1e-6)
    (second,) = pieces_of({"a.serialized": path.read_bytes()}, index=1)
    assert second.number == 1
    assert "colors of vertices (c)" in PlacedMesh.model_validate({"file": str(path)}).read()[1][0]


TOO_MANY = struct.pack("<2H", 0x041C, 4) + zlib.compress(struct.pack("<Ix2Q", 0, 3, 10**9))


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (file_of(packed(BALL.vertices, [[0, 1, 10**9]])), "vertices that are not there"),
        (file_of(SHAPES[0])[:-30], "shapes; at most 10,000 are read"),
        (file_of(packed(BALL.vertices, BALL.faces)[:-60]), "missing or damaged"),
        (b"\x1c\x04\x04\0" + bytes(8) + b"\xff\xff\xff\xff", "4,294,967,295 shapes"),
        (file_of(struct.pack("<2H", 7, 4)), "no serialized file of version 4"),
        (file_of(TOO_MANY), "GB of memory"),
    ],
)
def test_damaged_files_are_refused_before_they_take_memory(tmp_path, content, told):
    path = tmp_path / "a.serialized"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=told):
        PlacedMesh.model_validate({"file": str(path)}).read()
