"""Metal, gloss, glass, relief and lamps of glTF files: light against closed forms."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import Light, Meshes, PerspectiveCamera, Trajectory, build_scene
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Lighting
from megalopta.scenes.spectra.color import reflectance_of_color
from megalopta.scenes.spectra.spectrum import SPECTRA, flat, luminous

from ..scenes.meshes.files import Gltf, png
from .conftest import band_means, down, scene_of, square, vectorized

BANDS = ((420.0, 500.0), (500.0, 580.0), (580.0, 680.0))
CAMERA = PerspectiveCamera(width=8, height=8, fov_deg=2)
COLOR, HEIGHT = (0.8, 0.5, 0.2), 2.0
WHITE = np.array([[-50, 0, -50], [50, 0, -50], [50, 0, 50], [-50, 0, 50]], np.float32)
pytestmark = vectorized


def plate(tmp_path, material=None, lamp=None, turn=None, picture=None, **node):
    """A level square in a file, its y up, with a lamp at a height above its middle."""
    file = Gltf()
    uv = file.accessor(np.float32([[0, 0], [1, 0], [1, 1], [0, 1]]))
    file.triangle(WHITE, 0, [0, 2, 1, 0, 3, 2], TEXCOORD_0=uv)
    dull = {"pbrMetallicRoughness": {"metallicFactor": 0}}
    file.header |= {"materials": [{**dull, **(material or {})}], "nodes": [{"mesh": 0}]}
    if picture is not None:
        image = {"bufferView": file.view(png(picture)), "mimeType": "image/png"}
        file.header |= {"images": [image], "textures": [{"source": 0}]}
    if lamp:
        at = {
            "translation": [0, HEIGHT, 0],
            "rotation": turn or [-np.sqrt(0.5), 0, 0, np.sqrt(0.5)],
        }
        of = {"extensions": {"KHR_lights_punctual": {"light": 0}}}
        file.header["nodes"].append({**at, **of})
        file.header["extensions"] = {"KHR_lights_punctual": {"lights": [lamp]}}
    (tmp_path / "plate.glb").write_bytes(file.glb())
    return str(tmp_path / "plate.glb")


def radiance(scene, samples=256, depth=8):
    settings = RenderSettings(bands_nm=BANDS, samples_per_pixel=samples, max_depth=depth)
    poses = down(4)
    renderer = SceneRenderer(scene, CAMERA, settings, poses)
    return renderer.radiance(poses[0], 1).mean(axis=(0, 1), dtype=np.float64)


def built(path, lights):
    path_of_camera = Trajectory(frames=2, position_m=(0, 0, 4), look_at_m=(0, 0, 0), up=(1, 0, 0))
    return build_scene(Meshes(files=path, lights=lights), Light(), CAMERA, path_of_camera)


LAMPS = [
    # kind, turn, share of the intensity (cd) or of the illuminance (lux) that reaches the middle
    ({"type": "point"}, None, 1 / HEIGHT**2),
    ({"type": "spot", "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.4}}, None, 1 / HEIGHT**2),
    ({"type": "spot", "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.4}}, [0, 0, 0, 1], 0),
    ({"type": "directional"}, None, 1.0),
    ({"type": "directional"}, [-0.5, 0, 0, np.sqrt(0.75)], np.cos(np.radians(30))),
]


@pytest.mark.parametrize(("lamp", "turn", "share"), LAMPS)
def test_lamps_light_a_plate_as_their_candela_and_lux_say(tmp_path, lamp, turn, share):
    color = np.array([1.0, 0.6, 0.3])
    path = plate(tmp_path, None, {**lamp, "intensity": 300.0, "color": color.tolist()}, turn)
    scene = built(path, "file")
    found = radiance(scene, 512, 2)
    light = band_means(BANDS, scene.lamps[0].light)
    ours = reflectance_of_color((1, 1, 1))
    np.testing.assert_allclose(
        found, light * band_means(BANDS, ours) * share / np.pi, rtol=5e-3, atol=1e-12
    )
    # The color's own luminance, of sRGB's shares.
    expected = 300 * color @ [0.2126, 0.7152, 0.0722]
    assert luminous(scene.lamps[0].light) == pytest.approx(expected, rel=2e-3)


def test_what_glows_has_the_luminance_that_the_file_states(tmp_path):
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 250.0}}
    glow = {"emissiveFactor": [1, 1, 1], "extensions": strength}
    found = radiance(built(plate(tmp_path, glow), "file"), 512, 2)
    white = SPECTRA["D65"].scaled(250 / luminous(SPECTRA["D65"]))
    np.testing.assert_allclose(found, band_means(BANDS, white), rtol=5e-3)


SKY = 1e-9
BARE = {"KHR_materials_specular": {"specularFactor": 0}}
HEAD_ON = ((1.7 - 1) / (1.7 + 1)) ** 2
PANE = {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": 1.7}}
SURFACES = {
    "metal": (
        {"pbrMetallicRoughness": {"baseColorFactor": [*COLOR, 1], "roughnessFactor": 0}},
        band_means(BANDS, reflectance_of_color(COLOR)),
    ),
    # Both sides of a pane reflect, again and again.
    "pane": (
        {"pbrMetallicRoughness": {"roughnessFactor": 0, "metallicFactor": 0}, "extensions": PANE},
        np.full(3, 2 * HEAD_ON / (1 + HEAD_ON)),
    ),
    # One surface with nothing but glass below.
    "glass": (
        {
            "pbrMetallicRoughness": {"roughnessFactor": 0, "metallicFactor": 0},
            "extensions": {**PANE, "KHR_materials_volume": {"thicknessFactor": 1}},
        },
        np.full(3, HEAD_ON),
    ),
    "coat": (
        {
            "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0},
            "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1}, **BARE},
        },
        np.full(3, 0.035),  # with the wide skirts of Mitsuba's highlight; glTF has 0.04
    ),
    # A dark, smooth surface reflects what the index of refraction says.
    "lacquer": (
        {
            "pbrMetallicRoughness": {
                "baseColorFactor": [0, 0, 0, 1], "roughnessFactor": 0, "metallicFactor": 0,
            },
            "extensions": {"KHR_materials_ior": {"ior": 1.7}},
        },
        np.full(3, HEAD_ON),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SURFACES)
def test_a_surface_seen_head_on_reflects_an_even_sky_as_fresnel_says(tmp_path, name):
    material, reflected = SURFACES[name]
    scene = built(plate(tmp_path, material), "own")
    ((name, surface),) = scene.materials.items()
    mesh = next(iter(scene.assets.values())).parts[name]
    dark = square(-9.0), Material(flat(0.0))
    scene = scene_of(Lighting(flat(SKY)), (mesh, surface), dark)
    np.testing.assert_allclose(radiance(scene, 1024) / SKY, reflected, rtol=0.02)


def test_a_clearcoat_returns_no_more_light_than_it_gets(tmp_path):
    coat = {"KHR_materials_clearcoat": {"clearcoatFactor": 1}, **BARE}
    scene = built(plate(tmp_path, {"extensions": coat}), "own")
    (surface,) = scene.materials.values()
    room = trimesh.creation.icosphere(3, 9.0)
    inside = trimesh.Trimesh(room.vertices, room.faces[room.triangles_center[:, 2] < 0])
    inside.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(inside.vertices), 2)))
    furnace = scene_of(Lighting(flat(SKY)), (inside, surface))
    found = radiance(furnace, 256, 12) / SKY
    np.testing.assert_allclose(found, 1.0, atol=0.01)  # of a white one, just about all


@pytest.mark.parametrize("tilt", [(0.4, 0.0), (0.0, 0.4), (-0.3, 0.2)])
def test_a_relief_turns_the_normal_of_a_dull_surface(tmp_path, tilt):
    # Red along u, green against v of the file, which is downward in the picture.
    normal = np.array([*tilt, np.sqrt(1 - np.dot(tilt, tilt))])
    picture = np.tile(np.rint((normal + 1) / 2 * 255), (4, 4, 1))
    from_lamp = np.array([0.36, 0.8, 0.48])  # file's axes, y up
    turn = Rotation.align_vectors([from_lamp], [[0, 0, 1]])[0].as_quat().tolist()
    relief, lamp = {"normalTexture": {"index": 0}}, {"type": "directional", "intensity": 100.0}
    scene = built(plate(tmp_path, relief, lamp, turn, picture), "file")
    light = band_means(BANDS, scene.lamps[0].light) / np.pi
    cosine = from_lamp @ [normal[0], normal[2], -normal[1]]
    np.testing.assert_allclose(radiance(scene, 256, 2), light * cosine, rtol=0.015)
