import hashlib
import os

import numpy as np
import pytest
import trimesh

from megalopta.scenes.meshes import mesh_file
from megalopta.scenes.meshes.mesh_file import MeshFile
from megalopta.scenes.meshes.polygons import pieces_of

from .files import png


@pytest.fixture
def room(tmp_path):
    """A glTF file with its buffers, and an OBJ file with materials and a picture."""
    folder = tmp_path / "room"
    (folder / "textures").mkdir(parents=True)
    for name, content in trimesh.Scene(trimesh.creation.box()).export(file_type="gltf").items():
        (folder / name).write_bytes(content)
    (folder / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n")
    (folder / "a.mtl").write_text("newmtl m\nmap_Kd textures/a.png\n")
    (folder / "textures/a.png").write_bytes(png(np.zeros((2, 2, 3))))
    return folder


def test_a_file_alone_has_the_hash_of_its_content(tmp_path):
    path = tmp_path / "a.STL"
    path.write_bytes(b"solid")
    file = MeshFile.model_validate(str(path))
    assert file.sha256 == hashlib.sha256(b"solid").hexdigest()
    assert file.contents() == {"a.STL": b"solid"}


@pytest.mark.parametrize(
    ("name", "others"),
    [
        ("model.gltf", ["gltf_buffer_0.bin", "gltf_buffer_1.bin"]),
        ("a.obj", ["a.mtl", "textures/a.png"]),
    ],
)
def test_files_that_it_names_belong_to_it(room, name, others):
    file = MeshFile.model_validate(str(room / name))
    contents = file.contents()
    assert sorted(contents) == sorted([name, *others])
    assert next(iter(contents)) == name
    for other in others:
        kept = (room / other).read_bytes()
        (room / other).write_bytes(kept + b"\n")
        with pytest.raises(ValueError, match="has changed since it was first used"):
            file.check()
        assert MeshFile.model_validate(str(room / name)) != file
        (room / other).unlink()
        missing = rf"names '?{other}.*cannot be read \(no such file"
        told = "has changed" if other == "a.mtl" else missing
        with pytest.raises(ValueError, match=told):
            file.contents()
        (room / other).write_bytes(kept)
    file.check()


@pytest.mark.parametrize(
    "name", ["../a.png", "/etc/passwd", "C:\\a.png", "http://x.org/a.png", "textures/../../b.png"]
)
def test_nothing_outside_of_its_folder_is_read(room, name):
    (room.parent / "a.png").write_bytes(b"secret")
    (room / "a.mtl").write_text(f"newmtl m\nmap_Kd {name}\n")
    with pytest.raises(ValueError, match="not in its folder; put that file next to it"):
        MeshFile.model_validate(str(room / "a.obj"))


def test_links_out_of_its_folder_and_pipes_are_not_read(room):
    (room.parent / "secret").write_bytes(b"secret")
    (room / "textures/a.png").unlink()
    (room / "textures/a.png").symlink_to(room.parent / "secret")
    with pytest.raises(ValueError, match="not in its folder"):
        MeshFile.model_validate(str(room / "a.obj"))
    (room / "textures/a.png").unlink()
    os.mkfifo(room / "textures/a.png")
    with pytest.raises(ValueError, match="not a regular file"):
        MeshFile.model_validate(str(room / "a.obj"))


def test_all_together_are_bounded(room, monkeypatch):
    size = sum((room / name).stat().st_size for name in ("a.obj", "a.mtl", "textures/a.png"))
    monkeypatch.setattr(mesh_file, "MESH_BYTES", size)
    MeshFile.model_validate(str(room / "a.obj"))
    monkeypatch.setattr(mesh_file, "MESH_BYTES", size - 1)
    with pytest.raises(ValueError, match="larger than 0 MB"):
        MeshFile.model_validate(str(room / "a.obj"))


def test_other_kinds_are_refused_and_files_on_record_need_not_be_there(tmp_path):
    (tmp_path / "a.fbx").write_bytes(b"")
    with pytest.raises(
        ValueError,
        match=r"a\.fbx is not a \.glb, \.gltf, \.obj, \.ply, \.serialized, \.stl, \.xml file",
    ):
        MeshFile.model_validate(str(tmp_path / "a.fbx"))
    gone = {"path": str(tmp_path / "gone.glb"), "sha256": "0" * 64}
    with pytest.raises(ValueError, match=r"gone\.glb cannot be read \(no such file"):
        MeshFile.model_validate(gone).contents()


RNG = np.random.default_rng(4)
BALL = trimesh.creation.icosphere(1)


@pytest.mark.parametrize("kind", ["ply", "stl", "stl_ascii"])
def test_triangles_are_those_that_were_written(kind):
    name = "rock.ply" if kind == "ply" else "rock.stl"
    written = BALL.export(file_type=kind)
    (piece,) = pieces_of({name: written.encode() if isinstance(written, str) else written})
    assert piece.name == "rock" and len(piece.faces) == len(BALL.faces)
    assert trimesh.Trimesh(piece.vertices, piece.faces).volume == pytest.approx(BALL.volume, 1e-5)
    assert piece.normals is None
    if kind == "ply":
        (piece,) = pieces_of({name: BALL.export(file_type="ply", vertex_normal=True)})
        np.testing.assert_allclose(piece.normals, BALL.vertex_normals, atol=1e-6)


def test_points_have_no_triangles_and_pictures_are_refused():
    points = trimesh.PointCloud(RNG.random((9, 3))).export(file_type="ply")
    assert not len(pieces_of({"a.ply": points})[0].faces)
    named = BALL.export(file_type="ply").replace(b"format", b"comment TextureFile a.png\nformat", 1)
    with pytest.raises(ValueError, match="names a picture"):
        pieces_of({"a.ply": named})
