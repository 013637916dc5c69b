"""glTF against trimesh's own reader, and against arrays written by hand where trimesh gives up."""

import struct

import numpy as np
import pytest
import trimesh

from megalopta.scenes.meshes.gltf import pieces_of, unused
from megalopta.scenes.spectra.color import reflectance_of_color

from .files import Gltf, png, pose


def read(content):
    return list(pieces_of({"a.glb": content}))


def tree():
    """Nodes within nodes, turned, stretched and mirrored, one shape placed twice."""
    scene = trimesh.Scene()
    ball = trimesh.creation.icosphere(1)
    scene.add_geometry(ball, "moon", "ball", transform=pose(40, (1, 2, 3), (1, 2, 3), 0.5))
    scene.graph.update(
        "arm", "world", matrix=pose(25, (0, 1, 0), (5, 0, 0)) @ np.diag([1, 3, 1, 1])
    )
    scene.graph.update("earth", "arm", matrix=np.diag([-1, 1, 1, 1.0]), geometry="ball")
    box = trimesh.creation.box((1, 2, 3))
    scene.add_geometry(box, "hut", "box", "arm", transform=pose(10, (1, 0, 0), (0, 1, 0)))
    return scene


@pytest.mark.parametrize("kind", ["glb", "gltf", "embedded"])
def test_nodes_are_where_trimesh_puts_them(kind):
    scene = tree()
    if kind == "glb":
        contents = {"a.glb": scene.export(file_type="glb")}
    else:
        written = scene.export(file_type="gltf", embed_buffers=kind == "embedded")
        contents = {"model.gltf": written["model.gltf"], **written}
    pieces = {piece.name: piece for piece in pieces_of(contents)}
    assert sorted(pieces) == ["earth", "hut", "moon"]
    for name, piece in pieces.items():
        matrix, geometry = scene.graph[name]
        theirs = scene.geometry[geometry].copy().apply_transform(matrix)
        ours = trimesh.Trimesh(piece.vertices, piece.faces, process=False)
        # glTF holds float32.
        np.testing.assert_allclose(ours.bounds, theirs.bounds, atol=1e-5)
        assert ours.area == pytest.approx(theirs.area, rel=1e-5)
        # Mirrored, too, faces look outward: the volume is positive.
        assert ours.volume == pytest.approx(abs(theirs.volume), rel=1e-5)


def test_normals_stay_at_right_angles_to_a_stretched_surface():
    file = Gltf()
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(3, 3)).astype(np.float32)
    normal = np.cross(vertices[1] - vertices[0], vertices[2] - vertices[0])
    file.triangle(vertices, NORMAL=file.accessor(np.tile(normal, (3, 1)).astype(np.float32)))
    scale = [3.0, -0.5, 1.0]  # mirrored, too
    file.header["nodes"] = [{"mesh": 0, "scale": scale, "rotation": [0.6, 0, 0, 0.8]}]
    (piece,) = (each.sound() for each in read(file.glb()))
    edges = piece.vertices[1:] - piece.vertices[0]
    np.testing.assert_allclose(piece.normals @ edges.T, 0, atol=1e-6)
    a, b, c = piece.vertices[piece.faces[0]]
    assert np.dot(np.cross(b - a, c - a), piece.normals[0]) > 0


def test_quantized_values_are_those_of_the_specification():
    file = Gltf()
    padded = np.zeros((3, 4), np.int16)  # rows of eight bytes
    padded[:, :3] = [[0, 0, 0], [32767, 0, 0], [0, -32767, 0]]
    at = file.accessor(padded[:, :3], normalized=True)
    file.header["accessors"][at]["bufferView"] = file.view(padded.tobytes())
    file.header["bufferViews"][-1]["byteStride"] = 8
    file.header["extensionsRequired"] = ["KHR_mesh_quantization"]
    file.header["meshes"] = [{"primitives": [{"attributes": {"POSITION": at}}]}]
    (piece,) = read(file.glb())
    np.testing.assert_array_equal(piece.vertices, [[0, 0, 0], [1, 0, 0], [0, -1, 0]])


@pytest.mark.parametrize(
    ("mode", "faces"),
    [(5, [[0, 1, 2], [2, 1, 3], [2, 3, 4]]), (6, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]), (0, None)],
)
def test_strips_and_fans_are_triangles_and_points_are_not(mode, faces):
    file = Gltf()
    file.triangle(np.random.default_rng(1).random((5, 3)).astype(np.float32))
    file.header["meshes"][0]["primitives"][0]["mode"] = mode
    pieces = read(file.glb())
    assert [piece.faces.tolist() for piece in pieces] == ([] if faces is None else [faces])


def test_colors_are_linear_and_the_picture_is_turned_and_shifted_as_told():
    file = Gltf()
    codes = np.random.default_rng(3).integers(0, 256, (4, 6, 3))
    uv = np.float32([[0.1, 0.2], [0.9, 0.2], [0.1, 0.8]])
    file.triangle(material=0, TEXCOORD_1=file.accessor(uv))
    change = {"offset": [0.5, 0.25], "rotation": 0.3, "scale": [2, 3], "texCoord": 1}
    texture = {"index": 0, "extensions": {"KHR_texture_transform": change}}
    model = {"baseColorFactor": [0.5, 0.25, 1, 1], "baseColorTexture": texture}
    unread = {"emissiveFactor": [0, 0, 1], "alphaMode": "MASK"}
    file.paint(png(codes), {**model, "metallicFactor": 1.0}, name="bark", **unread)
    (piece,) = read(file.glb())
    assert piece.paint.name == "bark"
    told = [what for what, _ in unused({"a.glb": file.glb()})]
    assert told == ["transparency", "emission"]
    coded = codes[::-1] / 255
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    weight = piece.paint.material.texture.weight
    np.testing.assert_allclose(weight, linear * [0.5, 0.25, 1], atol=1e-6)
    # As in the extension's text, with v downward.
    cos, sin = np.cos(0.3), np.sin(0.3)
    x, y = (uv * [2, 3]).T
    expected = np.stack([0.5 + cos * x + sin * y, 1 - (0.25 - sin * x + cos * y)], axis=1)
    np.testing.assert_allclose(piece.uv, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"extensionsRequired": ["EXT_texture_dds"]}, "needs the extension EXT_texture_dds"),
        ({"asset": {"version": "1.0"}}, "version 1.0 of glTF"),
        ({"nodes": [{"children": [1, 1]}, {"mesh": 0}]}, "node 1 has two parents"),
        ({"nodes": [{"children": [0]}], "scenes": [{"nodes": [0]}]}, "node 0 has two parents"),
        ({"accessors": [{"count": 10**9, "type": "VEC3", "componentType": 5126}]}, "takes 72 GB"),
    ],
)
def test_what_is_not_supported_or_would_not_end_is_told(change, reason):
    file = Gltf()
    file.triangle()
    file.header |= change
    with pytest.raises(ValueError, match=reason):
        read(file.glb())


def test_colors_of_vertices_are_linear_between_them():
    file, rng = Gltf(), np.random.default_rng(4)
    corners = rng.random((5, 3)).astype(np.float32)
    colors = rng.integers(0, 65536, (5, 3)).astype(np.uint16)
    file.triangle(corners, COLOR_0=file.accessor(colors, normalized=True))
    file.header["meshes"][0]["primitives"][0]["mode"] = 5
    (piece,) = read(file.glb())
    weight = piece.paint.material.texture.weight
    height, width, _ = weight.shape
    for place, uv in zip(piece.vertices[piece.faces], piece.uv[piece.faces], strict=True):
        vertex = [np.abs(corners - corner).sum(axis=1).argmin() for corner in place]
        shares = rng.dirichlet(np.ones(3), 9)
        x, y = (shares @ uv * [width, height] - 0.5).T
        column, row = np.floor(x + 1e-9).astype(int), np.floor(y + 1e-9).astype(int)
        u, v = (x - column)[:, None], (y - row)[:, None]
        between = (1 - v) * ((1 - u) * weight[row, column] + u * weight[row, column + 1])
        between += v * ((1 - u) * weight[row + 1, column] + u * weight[row + 1, column + 1])
        # Where the fourth corner of a cell of colors would be below 0 or above 1, it is not.
        a, b, c = colors[vertex] / 65535
        if ((b + c - a >= 0) & (b + c - a <= 1)).all():
            np.testing.assert_allclose(between, shares @ colors[vertex] / 65535, atol=1e-5)
        np.testing.assert_allclose(weight[row.min(), column.min()], a, atol=1e-6)


@pytest.mark.parametrize("is_picture", [False, True])
@pytest.mark.parametrize(
    ("diffuse", "specular", "base", "metal"),
    [
        ((0.5, 0.2, 0.1), (0.04,) * 3, (0.5, 0.2, 0.1), 0.0),  # as a dielectric has it
        ((0.0, 0.0, 0.0), (0.9, 0.6, 0.3), (0.9, 0.6, 0.3), 1.0),  # gold
    ],
)
def test_diffuse_and_specular_colors_are_those_of_a_dielectric_or_metal(
    diffuse, specular, base, metal, is_picture
):
    file, name = Gltf(), "KHR_materials_pbrSpecularGlossiness"
    file.triangle(material=0, TEXCOORD_0=file.accessor(np.float32([[0, 0], [1, 0], [0, 1]])))
    gloss = {"diffuseFactor": [*diffuse, 1], "specularFactor": specular, "glossinessFactor": 0.75}
    if is_picture:
        white = file.view(png(np.full((2, 2, 4), 255)))
        file.header["images"] = [{"bufferView": white, "mimeType": "image/png"}]
        file.header["textures"] = [{"source": 0}]
        gloss["diffuseTexture"] = gloss["specularGlossinessTexture"] = {"index": 0}
    file.header["materials"] = [{"name": "a", "extensions": {name: gloss}}]
    (piece,) = read(file.glb())
    look = piece.paint.material.finish.parts["bsdf"].parts

    def value(part):
        return part.parts["bitmap"].mean(axis=(0, 1)) if hasattr(part, "kind") else part

    assert value(look["roughness"]) == pytest.approx(0.25, abs=1e-6)
    assert value(look["metallic"]) == pytest.approx(metal, abs=2e-3)
    if is_picture:
        np.testing.assert_allclose(value(look["base_color"]), base, atol=5e-3)
    else:
        expected = reflectance_of_color(base).values
        np.testing.assert_allclose(look["base_color"].values, expected, atol=5e-3)


def ktx2(colors):
    """A KTX 2 picture of blocks of 4 by 4 px of one color each (UASTC, mode 8)."""
    rows, columns, _ = colors.shape
    describing = struct.pack("<I4H", 44, 0, 0, 2, 40)
    describing += bytes([166, 1, 2, 0, 3, 3, 0, 0, 16, 0, 0, 0, 0, 0, 0, 0, 0, 0, 127, 0])
    describing += struct.pack("<3I", 0, 0, 2**32 - 1)
    blocks = b"".join(
        (23 | int.from_bytes(bytes([*color, 255]), "little") << 5).to_bytes(16, "little")
        for color in colors.reshape(-1, 3).tolist()
    )
    head = b"\xabKTX 20\xbb\r\n\x1a\n" + struct.pack(
        "<9I", 0, 1, 4 * columns, 4 * rows, 0, 0, 1, 1, 0
    )
    head += struct.pack("<4I2Q", 104, 44, 0, 0, 0, 0) + struct.pack("<3Q", 160, *[len(blocks)] * 2)
    return (head + describing).ljust(160, b"\0") + blocks


def basisu(content):
    """A triangle whose color is a picture in KTX 2."""
    file = Gltf()
    file.triangle(material=0, TEXCOORD_0=file.accessor(np.float32([[0, 0], [1, 0], [0, 1]])))
    file.paint(content, {"metallicFactor": 0}, "ktx2")
    file.header["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]
    file.header["extensionsRequired"] = ["KHR_texture_basisu"]
    return file.glb()


def test_pictures_of_ktx2_have_the_colors_of_their_blocks():
    codes = np.random.default_rng(2).integers(0, 256, (3, 2, 3))
    (piece,) = read(basisu(ktx2(codes)))
    coded = codes[::-1].repeat(4, axis=0).repeat(4, axis=1) / 255
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(piece.paint.material.texture.weight, linear, atol=1e-6)


@pytest.mark.parametrize(
    "harm", [lambda whole: whole[:-20], lambda whole: whole[:20] + b"\xff" * 20]
)
def test_damaged_pictures_of_ktx2_are_refused(harm):
    with pytest.raises(ValueError, match="picture of material 'material 0' cannot be read"):
        read(basisu(harm(ktx2(np.zeros((2, 2, 3), int)))))
