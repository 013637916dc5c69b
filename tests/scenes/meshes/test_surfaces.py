import numpy as np
import pytest
from pydantic import TypeAdapter

from megalopta.scenes.meshes.pieces import Paint, Piece, colored
from megalopta.scenes.meshes.reflectance import Curve, Reflectance, material_of
from megalopta.scenes.meshes.surfaces import Surfacing
from megalopta.scenes.spectra.reflectance import reflectance_of
from megalopta.scenes.spectra.spectrum import flat

RNG = np.random.default_rng(6)
RED = Paint("red", colored((0.5, 0.1, 0.0)))


def piece(number=0, faces=5, **more):
    vertices = RNG.normal(size=(2 * faces, 3))
    return Piece(
        number, f"thing {number}", vertices, RNG.integers(0, 2 * faces, (faces, 3)), **more
    )


def test_a_picture_is_three_weights_and_needs_coordinates():
    picture = RNG.random((3, 4, 3)).astype(np.float32)
    paint = Paint("bark", colored((1.0, 0.5, 0.25), picture))
    surfacing = Surfacing("a.glb")
    surfacing.objects([piece(paint=paint, uv=RNG.random((10, 2)))])
    (material,) = surfacing.materials.values()
    np.testing.assert_allclose(material.texture.weight, picture * [1.0, 0.5, 0.25], rtol=1e-6)
    assert material.known_nm == (360, 830)
    with pytest.raises(ValueError, match="'thing 0' of material 'bark' has no texture"):
        Surfacing("a.glb").objects([piece(paint=paint)])
    Surfacing("a.glb", {"bark": 0.3}).objects([piece(paint=paint)])


def test_given_reflectances_replace_colors_by_the_name_of_the_material_or_object():
    curve = Curve(wavelengths_nm=(400, 900), values=(0.1, 0.6))
    given = {"red": curve, "thing 1": 0.25, "thing 2": "soil"}
    surfacing = Surfacing("a.ply", given, colorless=0.125)
    surfacing.objects([piece(paint=RED), piece(1), piece(2), piece(3)])
    first, second, third, fourth = surfacing.materials.values()
    assert first.reflectance(650.0) == pytest.approx(0.35) and first.known_nm == (400, 900)
    assert second.reflectance == flat(0.25) and second.known_nm is None
    assert third.reflectance == reflectance_of("soil") and fourth.reflectance == flat(0.125)


def test_materials_of_one_name_stay_apart():
    other, uv = Paint("red", colored((0.0, 0.0, 1.0))), RNG.random((10, 2))
    pictures = [colored(np.ones(3), RNG.random((2, 2, 3)).astype(np.float32)) for _ in range(2)]
    barks = (piece(paint=Paint("bark", picture), uv=uv) for picture in pictures)
    given = [piece(paint=RED), piece(paint=other), *barks]
    surfacing = Surfacing("a.glb")
    surfacing.objects(given)
    names = ["a.glb: red", "a.glb: red (2)", "a.glb: bark", "a.glb: bark (2)"]
    assert list(surfacing.materials) == names


def test_pieces_of_an_object_and_a_material_are_one_mesh_and_smooth_ones_apart():
    smooth = RNG.normal(size=(10, 3))
    given = [
        piece(paint=RED),
        piece(1, paint=RED),
        piece(paint=RED),
        piece(paint=RED, normals=smooth),
    ]
    (_, first), (_, second) = Surfacing("a").objects(given)
    assert {name: len(mesh.faces) for name, mesh in first.parts.items()} == {
        "a: red": 10,
        "a: red, smooth": 5,
    }
    assert len(second.parts["a: red"].faces) == 5
    whole = Surfacing("a").whole(given)
    assert len(whole.parts["a: red"].faces) == 15


READ = TypeAdapter(Reflectance).validate_python


def test_a_curve_is_read_once_and_its_numbers_stay(tmp_path):
    path = tmp_path / "leaf.csv"
    path.write_text("# a leaf\nwavelength_nm,reflectance\n400, 0.05 # blue\n700,0.1\n1000,0.5\n")
    given = READ(str(path))
    path.unlink()
    assert given == Curve(wavelengths_nm=(400, 700, 1000), values=(0.05, 0.1, 0.5))
    assert READ(given.model_dump(mode="json")) == given
    assert material_of(given).known_nm == (400, 1000)
