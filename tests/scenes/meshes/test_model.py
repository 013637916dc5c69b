import re

import numpy as np
import pytest
import trimesh

from megalopta.scenes.meshes import pieces
from megalopta.scenes.meshes.model import PlacedMesh

from .files import Gltf
from .test_animation import mill
from .test_figures import arm

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
    pieces, _ = write(exported(name), name, up=up, scale=0.1).read()
    np.testing.assert_allclose(extent(pieces), np.multiply(0.1, expected), rtol=1e-6)


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
        given.read()
    scale = float(better.replace("\\", ""))
    given.model_copy(update={"scale": scale}).read()


@pytest.mark.parametrize("name", ["a.glb", "a.obj", "a.ply", "a.stl"])
def test_too_many_triangles_are_refused(write, monkeypatch, name):
    given = write(exported(name), name)
    assert given.read()
    monkeypatch.setattr(pieces, "TRIANGLE_BYTES", 2e9 / 11)
    with pytest.raises(ValueError, match=f"{name} takes .* GB of memory .*MEGALOPTA_DECODED_GB"):
        given.read()


@pytest.mark.parametrize("name", ["a.glb", "mill.glb", "arm.glb", "a.gltf", "a.obj", "a.ply"])
def test_a_damaged_file_is_one_sentence(tmp_path, name):
    """Cut, flipped and exchanged bytes: read, or refused with the path of the file."""
    rng = np.random.default_rng(7)
    if name == "a.gltf":
        whole = trimesh.Scene(BOX).export(file_type="gltf", embed_buffers=True)["model.gltf"]
    else:
        animated = {"mill.glb": mill, "arm.glb": arm}
        whole = animated[name]().glb() if name in animated else exported(name)
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
            PlacedMesh.model_validate({"file": str(path)}).read(
                *["animation"] * (name in ("mill.glb", "arm.glb"))
            )
        except ValueError as problem:
            assert name in str(problem)
            refused += 1
    assert refused > 20


def notes(model):
    return " ".join(model.read()[1])


@pytest.mark.parametrize(
    ("header", "told"),
    [
        ({"materials": [{"name": "lamp", "emissiveFactor": [1, 1, 1]}]}, "emission (lamp)"),
        ({"materials": [{"name": "pane", "alphaMode": "BLEND"}]}, "transparency (pane)"),
        (
            {
                "materials": [
                    {
                        "name": "jar",
                        "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}},
                    }
                ]
            },
            "metal of panes (jar)",  # of which there is some unless it says none
        ),
        ({"materials": [{"occlusionTexture": {"index": 0}}]}, "occlusionTexture (material 0)"),
        (
            {"extensionsUsed": ["KHR_lights_punctual", "EXT_mesh_gpu_instancing"]},
            "extensions (KHR_lights_punctual, EXT_mesh_gpu_instancing)",
        ),
        ({"cameras": [{"name": "front"}]}, "cameras (front)"),
        ({"scenes": [{"nodes": [0]}, {"name": "x\x1b[3m"}]}, r"other scenes (x\x1b[3m)"),
        ({"animations": [{"name": "walk", "channels": []}]}, "animations (walk)"),
        ({"samplers": [{"wrapS": 33071}]}, "pictures' clamping and mirroring"),
    ],
)
def test_what_of_a_gltf_file_has_no_effect_is_told(write, header, told):
    file = Gltf()
    file.triangle(material=0 if "materials" in header else None)
    file.header |= header
    assert told in notes(write(file.glb()))


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.obj", "l 1 2\np 1\n", "statements (l, p)"),
        ("a.obj", "s 1\n", "smoothing groups"),
        ("a.mtl", "d 0.5", "transparency (tin)"),
        ("a.mtl", "Ke 1 1 1", "emission (tin)"),
        ("a.mtl", "Ks 0.5 0.5 0.5", "gloss and metal (tin)"),
        ("a.mtl", "illum 5", "illum 5 (tin)"),
        ("a.mtl", "map_Bump rough.png", "map_bump pictures (tin)"),
    ],
)
def test_what_of_other_files_has_no_effect_is_told(write, tmp_path, name, content, told):
    triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    if name == "a.mtl":
        (tmp_path / name).write_text(f"newmtl tin\n{content}\n")
        name, made = "a.obj", f"mtllib a.mtl\nusemtl tin\n{triangle}"
    else:
        made = content + triangle
    assert told in notes(write(made, name))
    assert not notes(write("# plain\n" + triangle, "b.obj"))
