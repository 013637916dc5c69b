import re

import numpy as np
import pytest
import trimesh

from megalopta.scenes.meshes import pieces
from megalopta.scenes.meshes.model import PlacedMesh

BOX = trimesh.creation.box((1, 2, 3))


@pytest.fixture
def write(tmp_path):
    """Writes a file and returns its model."""

    def written(content, name="a.glb", **more):
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return PlacedMesh.model_validate({"file": str(path), **more})

    return written


def exported(name):
    return BOX.export(file_type=name.rpartition(".")[2])


def extent(pieces):
    return np.ptp(np.concatenate([piece.vertices for piece in pieces]), axis=0)


@pytest.mark.parametrize(
    ("name", "up", "expected"),
    [
        ("a.glb", None, [1, 3, 2]),
        ("a.obj", None, [1, 3, 2]),
        ("a.ply", None, [1, 2, 3]),
        ("a.stl", None, [1, 2, 3]),
        ("a.glb", "z", [1, 2, 3]),
        ("a.stl", "y", [1, 3, 2]),
    ],
)
def test_the_axis_that_is_up_becomes_z(write, name, up, expected):
    given = write(exported(name), name, up=up, scale=0.1)
    np.testing.assert_allclose(extent(given.pieces()), np.multiply(0.1, expected), rtol=1e-6)
    assert given.triangles() == 12


@pytest.mark.parametrize(
    ("factor", "better"),
    [(5e3, "0.001"), (1e4, "0.001"), (1e8, "1e-06"), (1e-4, "1000"), (1e-7, "1e\\+06")],
)
def test_wrong_units_are_told_with_a_better_scale(write, factor, better):
    shape = trimesh.creation.box((factor, factor, factor))
    given = write(shape.export(file_type="stl"), "a.stl")
    with pytest.raises(
        ValueError, match=rf"extends over {re.escape(f'{factor:.4g}')} m .*`scale: {better}`"
    ):
        given.pieces()
    scale = float(better.replace("\\", ""))
    given.model_copy(update={"scale": scale}).pieces()


@pytest.mark.parametrize("name", ["a.glb", "a.obj", "a.ply", "a.stl"])
def test_too_many_triangles_are_refused(write, monkeypatch, name):
    given = write(exported(name), name)
    assert given.pieces()
    monkeypatch.setattr(pieces, "TRIANGLE_BYTES", 2e9 / 11)
    with pytest.raises(ValueError, match=f"{name} takes .* GB of memory .*MEGALOPTA_DECODED_GB"):
        given.pieces()


@pytest.mark.parametrize("name", ["a.glb", "a.gltf", "a.obj", "a.ply", "a.stl"])
def test_a_damaged_file_is_one_sentence(tmp_path, name):
    """Cut, flipped and exchanged bytes: read, or refused with the path of the file."""
    rng = np.random.default_rng(7)
    if name == "a.gltf":
        whole = trimesh.Scene(BOX).export(file_type="gltf", embed_buffers=True)["model.gltf"]
    else:
        whole = exported(name)
        whole = whole.encode() if isinstance(whole, str) else whole
    path, refused = tmp_path / name, 0
    for case in range(150):
        content = bytearray(whole)
        if case % 2:
            content = content[: rng.integers(len(whole))]
        for place in rng.integers(len(content) or 1, size=rng.integers(1, 9) if content else 0):
            content[place] = rng.integers(256)
        path.write_bytes(content)
        try:
            PlacedMesh.model_validate({"file": str(path)}).pieces()
        except ValueError as problem:
            assert name in str(problem)
            refused += 1
    assert refused > 20
