import numpy as np
import pytest
import trimesh
from pydantic import TypeAdapter

from megalopta.scenes import Light, Meshes, PerspectiveCamera, Trajectory, build_scene
from megalopta.scenes.meshes import pieces
from megalopta.scenes.moving_objects import AnyObject
from megalopta.scenes.spectra.reflectance import reflectance_of

from .files import TRIANGLE, Gltf, png, pose

CAMERA, PATH = PerspectiveCamera(), Trajectory(frames=2)


@pytest.fixture
def files(tmp_path):
    """Paths of a room of two boxes and of a stone without color."""
    room = trimesh.Scene()
    for name, shift in ("table", (1, 0, 0)), ("chair\x1b[31m", (0, 2, 0)):
        box = trimesh.creation.box((1, 2, 3))
        look = trimesh.visual.material.PBRMaterial(name="wood", baseColorFactor=[99, 51, 0, 255])
        box.visual = trimesh.visual.TextureVisuals(material=look)
        room.add_geometry(box, name, transform=pose(shift=shift))
    room.export(tmp_path / "room.glb")
    trimesh.creation.icosphere(1).export(tmp_path / "stone.stl")
    return str(tmp_path / "room.glb"), str(tmp_path / "stone.stl")


def built(**given):
    return Meshes.model_validate(given).build(Light(), CAMERA, PATH)


def corners(scene, number):
    """Corners (2, 3) of the box around an object."""
    placement = scene.placements[number]
    meshes = scene.assets[placement.asset].parts.values()
    points = np.concatenate([mesh.vertices for mesh in meshes])
    placed = points @ placement.to_world[:3, :3].T + placement.to_world[:3, 3]
    return np.array([placed.min(axis=0), placed.max(axis=0)])


def test_a_file_is_placed_by_scale_turn_and_position(files):
    placed = {"scale": 2.0, "turn_deg": [0, 0, 90], "position_m": [10, 20, 30]}
    scene = built(files=[{"file": files[0], **placed}])
    # y of the file is up, and x becomes y.
    np.testing.assert_allclose(corners(scene, 0), [[7, 21, 28], [13, 23, 32]], atol=1e-6)


def test_the_ground_lies_just_below_everything(files):
    scene = built(files=files, ground="soil")
    ground, others = corners(scene, 3), [corners(scene, number) for number in range(3)]
    lowest = min(each[0, 2] for each in others)
    assert lowest - 1e-3 < ground[0, 2] == ground[1, 2] < lowest
    assert (ground[1, :2] - ground[0, :2] > 399).all()
    assert scene.placements[3].kind == "ground"
    assert scene.materials["ground"].reflectance == reflectance_of("soil")


def test_a_material_that_is_not_there_is_told_with_those_that_are(files):
    with pytest.raises(ValueError, match=r"no material 'wod' in the files; there are stone, wood"):
        built(files=files, materials={"wod": 0.4})
    scene = built(files=files, materials={"wood": 0.4, "stone": 0.2})
    assert {max(each.reflectance.values) for each in scene.materials.values()} == {0.4, 0.2}


def pictured(path, color=(1, 1, 1, 1)):
    """A triangle with a picture of 8 × 4 pixels in a color."""
    file = Gltf()
    file.triangle(material=0, TEXCOORD_0=file.accessor(TRIANGLE[:, :2]))
    file.paint(png(np.full((4, 8, 3), 99)), {"baseColorFactor": color}, name="tile")
    path.write_bytes(file.glb())
    return str(path)


def test_pictures_of_a_scene_have_a_bounded_size_in_all(tmp_path, monkeypatch):
    one, other, third = (pictured(tmp_path / f"{n}.glb") for n in range(3))
    monkeypatch.setattr(pieces, "TEXEL_BYTES", 2e9 / 95)
    assert len(built(files=[one, other]).materials) == 2
    with pytest.raises(ValueError, match="the scene with its pictures takes .*288 values"):
        built(files=[one, other, third])
    tinted = pictured(tmp_path / "tinted.glb", (0.4, 1, 1, 1))
    monkeypatch.setattr(pieces, "TEXEL_BYTES", 2e9 / 63)
    # That of an object is with those of the scene.
    scene, bird = Meshes(files=one), TypeAdapter(AnyObject).validate_python({"file": tinted})
    with pytest.raises(ValueError, match="object 0 .*tinted.glb with its pictures takes"):
        build_scene(scene, Light(), CAMERA, PATH, [bird])
