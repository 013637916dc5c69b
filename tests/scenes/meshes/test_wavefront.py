"""OBJ and MTL against trimesh, and against files written by hand."""

import numpy as np
import pytest
import trimesh

from megalopta.scenes.meshes.wavefront import pieces_of
from megalopta.scenes.spectra.color import reflectance_of_color

from .files import png

CORNERS = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
YARD = f"""# a comment \\
over two lines
mtllib colors.mtl
{CORNERS}
vt 0 0
vt 1 0
vt 1 1
vn 0 0 2
o cube
usemtl brick
f 1/1 3/2 4/3 2/2
f 5//1 6//1 8//1 7//1
o roof
usemtl tin
f 1/1/1 2/2/1 3/3/1
f 5 6 7 8 4
v 9 9 9
f -1 -2 -3
"""
COLORS = b"""newmtl brick
Kd 0.5 0.25 1
map_Kd tex\\brick.png
newmtl tin
Kd 0.5
Ke 0 0 3
d 0.5
"""


def read(text, **files):
    return list(pieces_of({"yard.obj": text.encode(), **files}))


def yard():
    picture = png(np.full((2, 2, 3), 188))
    return read(YARD, **{"colors.mtl": COLORS, "tex/brick.png": picture})


def triangles(piece):
    return sorted(piece.vertices[piece.faces].tolist())


def test_polygons_of_any_form_become_fans_of_their_object_and_material():
    cube, roof = yard()
    v = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)] + [[9, 9, 9]], float)
    fans = [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6]]
    assert triangles(cube) == sorted(v[fans].tolist())
    fans = [[0, 1, 2], [4, 5, 6], [4, 6, 7], [4, 7, 3], [8, 7, 6]]
    assert triangles(roof) == sorted(v[fans].tolist())
    assert [(piece.number, piece.name) for piece in (cube, roof)] == [(0, "cube"), (1, "roof")]


def test_materials_are_those_of_the_library():
    brick, tin = (piece.paint.material for piece in yard())
    codes = np.array([0.5, 0.25, 1, 188 / 255])
    *color, gray = ((codes + 0.055) / 1.055) ** 2.4
    expected = np.broadcast_to(np.multiply(gray, color), (2, 2, 3))
    np.testing.assert_allclose(brick.texture.weight, expected, rtol=1e-5)
    assert tin.reflectance == reflectance_of_color(3 * [color[0]])


def test_without_its_library_a_material_is_a_name_without_color():
    brick, tin = (piece.paint for piece in read(YARD))
    assert [brick.name, tin.name] == ["brick", "tin"]
    assert brick.material is None and tin.material is None
    (plain,) = read(f"{CORNERS}f 1 2 3\n")
    assert plain.paint.name is None


def test_coordinates_and_normals_are_used_where_all_corners_have_them():
    text = CORNERS + "vt 0.25 0.5\nvt 1 0\nvn 0 0 1\ng wall\nf 1/1/1 2/2/1 3/1/1\n"
    (piece,) = read(text)
    assert piece.name == "wall"
    corner = piece.vertices[piece.faces[0]].tolist().index([0, 0, 1])
    assert piece.uv[piece.faces[0][corner]].tolist() == [1, 0]
    assert (piece.normals == [0, 0, 1]).all()
    partly = [piece.uv for piece in yard()]
    assert partly == [None, None]


def test_trimesh_reads_the_same_surface():
    shape = trimesh.creation.annulus(0.5, 1, 2, sections=17)
    (piece,) = read(shape.export(file_type="obj"))
    ours = trimesh.Trimesh(piece.vertices, piece.faces)
    assert ours.volume == pytest.approx(shape.volume, rel=1e-6)
    np.testing.assert_allclose(ours.bounds, shape.bounds, atol=1e-6)


MISSING = "vertices, coordinates or normals that are not there"


@pytest.mark.parametrize(
    ("face", "told"),
    [
        *((face, MISSING) for face in ("f 1 2 99", "f 1 2 -9", "f 0 1 2")),
        *((face, MISSING) for face in ("f 1/7 2/1 3/1", "f 1//9 2//1 3//1")),
        *((face, "could not convert") for face in ("f a b c", "f 1 2.5 3")),
    ],
)
def test_corners_that_are_not_there_or_no_numbers_are_refused(face, told):
    with pytest.raises(ValueError, match=told):
        read(f"{CORNERS}{face}\n")
