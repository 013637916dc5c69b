"""Mitsuba's XML from strangers: what is read, and what is refused in one sentence."""

import numpy as np
import pytest

from megalopta.scenes import Light, Meshes, PerspectiveCamera, Trajectory, build_scene
from megalopta.scenes.meshes.model import PlacedMesh

CAMERA, PATH = PerspectiveCamera(), Trajectory()
METAL = '<bsdf type="roughconductor" id="Brass"/>'


@pytest.fixture
def write(tmp_path):
    """Writes elements as a scene, and returns its path."""

    def write(body, version="3.0.0", before=""):
        path = tmp_path / "yard" / "scene.xml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(f'{before}<scene version="{version}">{body}</scene>')
        return str(path)

    return write


def square(surface="", more=""):
    return f'<shape type="rectangle" id="table">{more}{surface}</shape>'


def scene_of(path, **more):
    return build_scene(Meshes(files=(path,), **more), Light(), CAMERA, PATH)


def material_of(path, **more):
    (material,) = scene_of(path, **more).materials.values()
    return material


def test_surfaces_that_are_not_diffuse_are_refused_by_name_unless_given(write):
    path = write(square(METAL))
    with pytest.raises(ValueError, match=r"material 'Brass' is of Mitsuba's type 'roughconductor'"):
        scene_of(path)
    assert material_of(path, materials={"Brass": 0.3}).reflectance(600) == 0.3
    checks = '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf>'
    with pytest.raises(ValueError, match=r"'table' is with a reflectance of type 'checkerboard'"):
        scene_of(write(square(checks)))


def test_spectra_are_numbers_tables_or_files_and_known_where_they_are(write, tmp_path):
    def diffuse(spectrum):
        return square(f'<bsdf type="diffuse"><spectrum name="reflectance" {spectrum}/></bsdf>')

    assert material_of(write(diffuse('value="0.25"'))).known_nm is None
    table = material_of(write(diffuse('value="400:0.1, 800:0.5"')))
    assert table.known_nm == (400, 800)
    assert table.reflectance(600) == pytest.approx(0.3)
    path = write(diffuse('filename="leaf.spd"'))
    (tmp_path / "yard/leaf.spd").write_text("# nm, share\n500 0.2\n900 0.6\n")
    leaf = material_of(path)
    assert leaf.known_nm == (500, 900)
    assert leaf.reflectance(700) == pytest.approx(0.4)


def test_names_of_older_versions_are_understood(write):
    step = '<transform name="toWorld"><translate x="3"/></transform>'
    (piece,) = PlacedMesh(file=write(square(more=step), "0.6.0"), up="z").pieces()
    np.testing.assert_allclose(piece.vertices.mean(axis=0), [3, 0, 0])


def test_defaults_fill_what_is_not_given(write):
    scale = '<transform name="to_world"><scale value="$size"/></transform>'
    path = write(
        '<default name="size" value="4"/><default name="size" value="9"/>' + square(more=scale)
    )
    (piece,) = PlacedMesh(file=path).pieces()
    assert np.ptp(piece.vertices, axis=0).max() == 8


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<include filename="other.xml"/>', "it includes another XML file"),
        (square('<ref id="gold"/>'), "it names 'gold', which is not defined"),
        ('<shape type="hair"/>', "a shape of type 'hair'; export it as a mesh"),
        ("<a>" * 60 + "</a>" * 60, "nested in more than 40 levels"),
        ("<shape>", "it is no XML: mismatched tag"),
        ("", "no triangle with an area"),
        (
            '<shape type="obj"><string name="filename" value="/etc/passwd"/></shape>',
            "/etc/passwd, which is not in its folder",
        ),
        (
            '<shape type="ply"><string name="filename" value="../secret.ply"/></shape>',
            r"\.\./secret\.ply, which is not in its folder",
        ),
        (
            square('<bsdf type="diffuse"><texture type="bitmap" name="reflectance">'
            '<string name="filename" value="gone.png"/></texture></bsdf>'),
            r"gone\.png, which cannot be read",
        ),
        (
            '<default name="a" value="xxxxxxxxxx"/>'
            + "".join(f'<default name="a{n}" value="{f"$a{n - 1}" * 10}"/>' for n in range(1, 9)).replace(
                "$a0", "$a"
            ),
            "too long a text",
        ),
        (
            '<shape type="shapegroup" id="g"><shape type="sphere"/></shape>'
            + '<shape type="instance"><ref id="g"/></shape>' * 1200,
            r"more than 1e\+07 triangles",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_one_sentence(write, body, message):
    with pytest.raises(ValueError, match=message) as refused:
        scene_of(write(body))
    assert "\n  Value error" in str(refused.value) or "\n" not in str(refused.value)


def test_entities_are_refused_before_they_grow(write):
    bomb = '<!DOCTYPE scene [<!ENTITY a "xxxx"><!ENTITY b "&a;&a;&a;">]>'
    with pytest.raises(ValueError, match="it defines entities, which are not read"):
        scene_of(write("&b;", before=bomb))


def test_other_encodings_are_refused(write, tmp_path):
    path = write("")
    (tmp_path / "yard/scene.xml").write_text('<scene version="3.0.0"/>', "utf-16")
    with pytest.raises(ValueError, match="its XML is not UTF-8"):
        scene_of(path)
