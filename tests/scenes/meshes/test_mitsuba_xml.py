"""Mitsuba's XML from strangers: what is read, and what is refused in one sentence."""

from pathlib import Path

import numpy as np
import pytest

from megalopta.render import mi
from megalopta.scenes import Light, Meshes, PerspectiveCamera, Trajectory, build_scene
from megalopta.scenes.meshes.model import PlacedMesh

CAMERA, PATH = PerspectiveCamera(), Trajectory()
HAIR = '<bsdf type="hair" id="Fur"/>'
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


@pytest.mark.parametrize(
    ("inside", "known_nm"),
    [
        ('<string name="material" value="Au"/>', (360, 830)),
        ('<string name="material" value="MgO_palik"/>', (360, 767.6)),
        ('<string name="material" value="none"/>', None),
        ('<rgb name="specular_reflectance" value="0.5"/>', (360, 830)),
        ('<spectrum name="eta" value="300:1, 900:2"/><spectrum name="k" value="1.5"/>', (300, 900)),
    ],
)
def test_metal_is_known_where_its_data_are(write, inside, known_nm):
    metal = METAL.replace("/>", f">{inside}</bsdf>")
    assert material_of(write(square(metal))).known_nm == known_nm


@pytest.mark.parametrize(
    "inside",
    [
        '<string name="material" value="../../Au"/>',
        '<string name="type" value="python"/>',
        '<string name="id" value="a"/>',
        '<float name="alpha" value="nan"/>',
        f'<integer name="alpha" value="{"9" * 4000}"/>',
        '<rgb name="specular_reflectance" value="inf"/>',
        '<texture name="alpha" type="volume"/>',
        '<phase name="alpha" type="hg"/>',
    ],
)
def test_parameters_that_reach_beyond_a_surface_are_refused(write, inside):
    metal = METAL.replace("/>", f">{inside}</bsdf>")
    with pytest.raises(ValueError, match=r"material 'Brass' is (with a|of Mitsuba's)"):
        scene_of(write(square(metal)))


def test_surfaces_that_are_not_kept_are_refused_by_name_unless_given(write):
    path = write(square(HAIR))
    with pytest.raises(ValueError, match=r"material 'Fur' is of Mitsuba's type 'hair'"):
        scene_of(path)
    assert material_of(path, materials={"Fur": 0.3}).reflectance(600) == 0.3
    waves = '<bsdf type="diffuse"><texture type="mesh_attribute" name="reflectance"/></bsdf>'
    with pytest.raises(ValueError, match=r"material 'table' is of Mitsuba's type 'mesh_attribute'"):
        scene_of(write(square(waves)))
    raw = '<texture type="bitmap" name="reflectance"><boolean name="raw" value="true"/></texture>'
    finish = material_of(write(square(f'<bsdf type="diffuse">{raw}</bsdf>'))).finish
    assert finish.kind == "diffuse"


def test_defaults_and_names_of_older_versions_are_understood(write):
    steps = '<scale value="$size"/><translate x="3"/>'
    shape = square(more=f'<transform name="toWorld">{steps}</transform>')
    sizes = '<default name="size" value="4"/><default name="size" value="9"/>'
    ((piece,), _) = PlacedMesh(file=write(sizes + shape, "0.6.0"), up="z").read()
    np.testing.assert_allclose(piece.vertices.mean(axis=0), [3, 0, 0])
    assert np.ptp(piece.vertices, axis=0).max() == 8


def test_entities_and_other_encodings_are_refused(write):
    path = write("&b;", before='<!DOCTYPE scene [<!ENTITY a "xxxx"><!ENTITY b "&a;&a;&a;">]>')
    with pytest.raises(ValueError, match="it defines entities, which are not read"):
        scene_of(path)
    Path(path).write_text('<scene version="3.0.0"/>', "utf-16")
    with pytest.raises(ValueError, match="its XML is not UTF-8"):
        scene_of(path)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<include filename="other.xml"/>', "it includes another file"),
        (square('<ref id="gold"/>'), "it names 'gold', which is not defined"),
        ('<shape type="hair"/>', "a shape of type 'hair' is not read; export it as PLY or OBJ"),
        (square('<subsurface type="dipole"/>'), "'table' has a part 'subsurface', which is not"),
        (
            square('<medium name="exterior" type="homogeneous"/>'),
            "material 'table' is the boundary of a medium, which is not rendered",
        ),
        ("<a>" * 60 + "</a>" * 60, "nested in more than 40 levels"),
        ('<shape type="ply"/>', "it has a mesh or picture without a filename"),
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
            f'<default name="a" value="{"x" * 1000}"/>' + '<b c="$a $a $a $a"/>' * 5000,
            "too long a text",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_one_sentence(write, body, message):
    with pytest.raises(ValueError, match=message) as refused:
        scene_of(write(body))
    assert "\n  Value error" in str(refused.value) or "\n" not in str(refused.value)


@pytest.mark.parametrize("last", ["b0", "b30", "gold"])
def test_surfaces_that_repeat_their_parts_are_bounded(write, last):
    """Thirty that name the next one twice, and the last the first: 2³⁰ parts, or no end."""
    blends = "".join(
        f'<bsdf type="blendbsdf" id="b{n}">' + f'<ref id="b{n + 1}"/>' * 2 + "</bsdf>"
        for n in range(30)
    )
    blends += f'<bsdf type="mask" id="b30"><ref id="{last}"/></bsdf>'
    blends += METAL.replace("Brass", "gold")
    with pytest.raises(ValueError, match="material 'b0' is of more than 200 parts"):
        scene_of(write(blends + square('<ref id="b0"/>')))


@pytest.mark.parametrize("kind", ["envmap", "constant", "point"])
def test_lights_of_the_file_that_are_not_read_are_refused_where_they_count(write, kind):
    lamp = '<emitter type="area" id="glow"><rgb name="radiance" value="2"/></emitter>'
    lamp += square('<ref id="glow"/>')
    assert material_of(write(lamp), lights="file").emission
    path = write(f'<emitter type="{kind}"/>' + lamp)
    assert scene_of(path).lighting is not None
    with pytest.raises(
        ValueError, match=rf"scene\.xml: .* emitter of type '{kind}' is not rendered"
    ):
        scene_of(path, lights="file")


@pytest.mark.parametrize(
    ("spectrum", "at_500_nm", "known_nm"),
    [
        ('value="0.25">', 0.25, None),
        ('value="400:0.1, 800:0.5">', 0.2, (400, 800)),
        ('filename="leaf.spd">', 0.2, (400, 900)),
        ('type="uniform"><float name="value" value="0.4"/>', 0.4, None),
        (
            'type="irregular"><string name="wavelengths" value="400, 600"/>'
            '<string name="values" value="0.1, 0.5"/>',
            0.3,
            (400, 600),
        ),
        (
            'type="regular"><float name="wavelength_min" value="400"/>'
            '<float name="wavelength_max" value="700"/><string name="values" value="0, 0.3, 0.6"/>',
            0.2,
            (400, 700),
        ),
    ],
)
def test_spectra_are_those_of_surfaces_and_lamps(write, tmp_path, spectrum, at_500_nm, known_nm):
    write("")
    (tmp_path / "yard/leaf.spd").write_text("# nm, share\n400 0.1\n900 0.6\n")
    element = f'<spectrum name="NAME" {spectrum}</spectrum>'
    surface = f'<bsdf type="diffuse">{element.replace("NAME", "reflectance")}</bsdf>'
    lamp = f'<emitter type="area">{element.replace("NAME", "radiance")}</emitter>'
    diffuse = material_of(write(square(surface)))
    assert diffuse.reflectance(500) == pytest.approx(at_500_nm)
    assert diffuse.known_nm == known_nm
    shining = material_of(write(square(lamp)), lights="file").emission.radiance
    assert shining(500) == pytest.approx(at_500_nm)


def test_daylight_is_that_of_mitsuba(write):
    d65 = '<spectrum name="radiance" type="d65"><float name="scale" value="2"/></spectrum>'
    for radiance in (d65, '<float name="radiance" value="3"/>', ""):
        path = write(square(f'<emitter type="area">{radiance}</emitter>'))
        mi.set_variant("scalar_spectral")
        hit = mi.SurfaceInteraction3f()
        hit.wavelengths, hit.wi = [450.0, 555.0, 612.0, 690.0], [0, 0, 1]
        theirs = np.array(mi.load_file(path).emitters()[0].eval(hit))
        ours = material_of(path, lights="file").emission.radiance([450, 555, 612, 690])
        np.testing.assert_allclose(ours, theirs, rtol=5e-4)


@pytest.mark.parametrize(
    ("lamp", "reason"),
    [
        ('<emitter type="area"><texture type="bitmap" name="radiance"/></emitter>', "a texture"),
        ('<emitter type="area"><spectrum type="d66" name="radiance"/></emitter>', "type 'd66'"),
        ('<emitter type="projector"/>', "of type projector"),
    ],
)
def test_lamps_are_refused_by_name_only_where_they_shall_shine(write, lamp, reason):
    path = write(square(lamp))
    assert scene_of(path)
    with pytest.raises(ValueError, match=rf"object 'table' is a lamp .*{reason}.*lights 'own'"):
        scene_of(path, lights="file")


@pytest.mark.parametrize(
    ("shape", "reason"),
    [
        ('type="sphere"><float name="radius" value="-1"/>', "shape 'it' has radius -1"),
        ('type="sphere"><float name="radius" value="nan"/>', "shape 'it' has radius nan"),
        ('type="cylinder"><float name="radius" value="0"/>', "shape 'it' has radius 0"),
        ('type="cylinder"><point name="p1" x="0"/>', "shape 'it' has p0 .* no length"),
        *(
            (f'type="cube"><transform name="to_world"><{step}/></transform>', reason)
            for step, reason in (
                ('translate x="1e300"', "shape 'it': translate .*1e300.*beyond 1e\\+12"),
                ('translate value="nan, 0, 0"', "shape 'it': translate .*nan.* is not finite"),
                ('scale value="0"', "shape 'it': scale .*'0'.* leaves no volume"),
                ('scale x="0"', "shape 'it': scale .* leaves no volume"),
                ('rotate angle="30"', "shape 'it': rotate .* is not finite"),
                ('matrix value="1 2 3  2 4 6  0 0 1"', "shape 'it': matrix .* leaves no volume"),
                (f'matrix value="{"1 0 0 0 0 " * 3} .5"', "matrix .* is a perspective map"),
            )
        ),
    ],
)
def test_shapes_and_places_that_cannot_be_are_refused_with_element_and_value(write, shape, reason):
    path = write(f'<shape id="it" {shape}</shape>')
    with pytest.raises(ValueError, match=rf"scene\.xml.*{reason}"):
        scene_of(path)
