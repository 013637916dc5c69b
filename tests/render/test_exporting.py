"""Exported scenes in plain Mitsuba, against this program's own frames."""

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from megalopta.render import (
    RenderSettings,
    SceneRenderer,
    activate,
    choose_variant,
    export_scene,
    mi,
)
from megalopta.scenes import (
    CylindricalCamera,
    Forest,
    Grating,
    Light,
    Meshes,
    MovingObject,
    PerspectiveCamera,
    Trajectory,
    build_scene,
)
from megalopta.scenes.motion import Drift

from .conftest import vectorized

CAMERA = PerspectiveCamera(width=40, height=30, fov_deg=60)
BANDS = ((400, 500), (500, 600), (600, 700), (700, 800))
SETTINGS = RenderSettings(bands_nm=BANDS, samples_per_pixel=64)
PATH = Trajectory(frames=2, position_m=(0, 0, 1.5), look_at_m=(10, 0, 1.5), velocity_m_s=(0, 0, 0))
SEEDS = 12


@pytest.fixture
def own(tmp_path):
    """A textured floor with colored corners of a ball on it."""
    floor = trimesh.creation.box((20, 0.1, 20))
    picture = np.random.default_rng(0).integers(0, 256, (8, 8, 3), dtype=np.uint8)
    look = PBRMaterial(name="tiles", baseColorTexture=Image.fromarray(picture))
    floor.visual = TextureVisuals(uv=floor.vertices[:, [0, 2]], material=look)
    ball = trimesh.creation.icosphere(2)
    ball.visual.vertex_colors = np.random.default_rng(1).integers(
        0, 256, (len(ball.vertices), 4), dtype=np.uint8
    )
    scene = trimesh.Scene([floor])
    place = np.eye(4)
    place[:3, 3] = 5, 1, 0
    scene.add_geometry(ball, "ball", transform=place)
    scene.export(tmp_path / "own.glb")
    return Meshes(files=str(tmp_path / "own.glb"), ground=0.2)


def means(radiance):
    """Mean radiance (SEEDS, B) of frames by seed."""
    return np.array([radiance(seed).mean(axis=(0, 1), dtype=np.float64) for seed in range(SEEDS)])


@vectorized
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["grating", "forest", "own"])
def test_plain_mitsuba_sees_the_same_radiance_in_every_band(kind, own, tmp_path):
    described = {"grating": Grating(), "forest": Forest(trees=8, density_per_ha=100), "own": own}
    box = MovingObject(position_m=(4, 1, 1.5), motion=Drift(velocity_m_s=(0, -9, 0)))
    moving = () if kind == "grating" else (box,)
    scene = build_scene(described[kind], Light(level="daylight"), CAMERA, PATH, moving)
    pose, time_s = PATH.poses()[1], float(PATH.times_s[1])
    file = export_scene(scene, CAMERA, SETTINGS, pose, tmp_path / "exported", time_s)
    activate(choose_variant("auto"))
    renderer = SceneRenderer(scene, CAMERA, SETTINGS)
    ours = means(lambda seed: renderer.radiance(pose, seed, time_s))
    plain = mi.load_file(str(file))
    theirs = means(lambda seed: np.array(mi.render(plain, seed=seed + 100, spp=64)))
    error = np.sqrt((ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / SEEDS)
    assert (error < 0.01 * ours.mean(axis=0)).all()
    # Twelve differences from 22 degrees of freedom exceed 8 with a probability of 7e-7.
    assert (np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) < 8 * error).all()


@pytest.mark.parametrize(
    ("camera", "light", "reason"),
    [
        (CAMERA, Light(sky="natural"), "light.sky 'natural'"),
        (CylindricalCamera(), Light(), "camera.kind 'cylindrical'"),
    ],
)
def test_what_plain_mitsuba_does_not_have_is_refused(own, tmp_path, camera, light, reason):
    scene = build_scene(own, light, camera, PATH)
    with pytest.raises(ValueError, match=reason):
        export_scene(scene, camera, SETTINGS, PATH.poses()[0], tmp_path / "out")
    assert not (tmp_path / "out").exists()
