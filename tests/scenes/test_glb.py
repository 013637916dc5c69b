"""Scenes as GLB, read back as scenes."""

import numpy as np
import pytest
import trimesh
from trimesh.visual import TextureVisuals

from megalopta.scenes import Light, Meshes, PerspectiveCamera, Trajectory, build_scene
from megalopta.scenes.glb import glb_of
from megalopta.scenes.material import ColorTexture, Material
from megalopta.scenes.motion import Drift, RigidMotion
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.color import BLUE, GREEN, RED, reflectance_of_color
from megalopta.scenes.spectra.spectrum import flat

TILES = np.random.default_rng(2).random((4, 8, 3), np.float32)
COLOR = (0.6, 0.2, 0.4)


def scene():
    box, floor = trimesh.creation.box((1, 2, 3)), trimesh.Trimesh(
        [[-4, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0.0]], [[0, 1, 2], [0, 2, 3]], process=False
    )  # fmt: skip
    floor.visual = TextureVisuals(uv=np.array([[0, 0], [2, 0], [2, 1], [0, 1.0]]))
    turned = trimesh.transformations.rotation_matrix(0.4, (0, 0, 1), (0, 0, 0))
    turned[:3, 3] = 1, 2, 3
    drift = RigidMotion((0, 0, 0), Drift(velocity_m_s=(1, 0, 0)))
    return Scene(
        {
            "red": Material(reflectance_of_color(COLOR)),
            "tiles": Material(flat(0.0), ColorTexture(TILES, (RED, GREEN, BLUE))),
        },
        {"box": Asset({"red": box}), "floor": Asset({"tiles": floor})},
        (
            Placement("floor", "ground", np.eye(4)),
            Placement("box", "hut", turned),
            Placement("box", "cart", np.eye(4), drift),
        ),
    )


@pytest.fixture
def again(tmp_path):
    path = tmp_path / "scene.glb"
    path.write_bytes(glb_of(scene(), time_s=2.0))
    return build_scene(Meshes(files=(str(path),)), Light(), PerspectiveCamera(), Trajectory())


def corners(scene, number, shift=(0, 0, 0)):
    placement = scene.placements[number]
    (mesh,) = scene.assets[placement.asset].parts.values()
    points = mesh.vertices @ placement.to_world[:3, :3].T + placement.to_world[:3, 3] + shift
    return np.unique(points.round(4), axis=0)


def test_objects_come_back_at_their_places_and_times(again):
    names = {placement.kind: number for number, placement in enumerate(again.placements)}
    assert names.keys() == {"ground 1", "hut 2", "cart 3"}
    for name, number in ("ground 1", 0), ("hut 2", 1):
        np.testing.assert_allclose(corners(again, names[name]), corners(scene(), number), atol=2e-4)
    moved = corners(scene(), 2, (2, 0, 0))
    np.testing.assert_allclose(corners(again, names["cart 3"]), moved, atol=2e-4)


def test_colors_and_pictures_come_back_to_8_bits(again):
    materials = {name: each for name, each in again.materials.items() if not each.texture}
    for each in materials.values():
        found = np.array([each.reflectance(nm) for nm in (450, 550, 650)])
        expected = np.array([reflectance_of_color(COLOR)(nm) for nm in (450, 550, 650)])
        # 8 bits, and matching functions of about 1 %.
        np.testing.assert_allclose(found, expected, atol=0.02)
    (tiles,) = (each.texture.weight for each in again.materials.values() if each.texture)
    # sRGB of 8 bits has steps of up to 0.9 %.
    np.testing.assert_allclose(tiles, TILES, atol=0.02)
