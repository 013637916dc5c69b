import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import PerspectiveCamera, Trajectory
from megalopta.scenes.lighting.cloudy_sky import DOME_M, LOWEST_DEG, clouds, under_clouds
from megalopta.scenes.lighting.light import Light
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat

WAVELENGTH_NM = 560.0


@pytest.mark.slow
def test_clouds_give_a_horizontal_plane_the_light_of_a_uniform_sky():
    pattern = clouds(3)
    rows, columns = pattern.shape
    edges = np.radians(np.linspace(LOWEST_DEG, 90, rows + 1)).clip(0)
    # ∫ sin e · cos e de = sin² e / 2; a uniform sky of 1 gives π. Rows are 0.33° high.
    solid = np.diff(np.sin(edges) ** 2) / 2 * (2 * np.pi / columns)
    assert solid @ pattern.sum(axis=1) == pytest.approx(np.pi, rel=1e-4)


def plate():
    corners = 50.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    mesh = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    return Scene(
        {"plate": Material(flat(0.5))},
        {"plate": Asset({"plate": mesh})},
        (Placement("plate", "plate", np.eye(4)),),
    )


@pytest.mark.slow
@pytest.mark.parametrize("disc_fraction", [0.0, 0.8])
def test_a_plate_is_as_bright_as_under_the_uniform_sky_and_sun(disc_fraction):
    light = Light(level="daylight", disc_fraction=disc_fraction, disc_elevation_deg=50)
    scene = under_clouds(plate(), light.lighting(), WAVELENGTH_NM, seed=2)
    pose = Trajectory(frames=1, position_m=(0, 0, 2), look_at_m=(1, 0, 0)).poses()[0]
    settings = RenderSettings(samples_per_pixel=64, max_depth=2, bands_nm=((555, 565),))
    camera = PerspectiveCamera(width=32, height=32, fov_deg=40)
    radiance = SceneRenderer(scene, camera, settings).radiance(pose, 0)
    irradiance = light.resolved().spectrum()(WAVELENGTH_NM)
    # 65 000 paths of relative scatter below 1.5: σ < 0.6 %; the band moves it by less than 0.1 %.
    assert radiance.mean() == pytest.approx(0.5 * irradiance / np.pi, rel=0.03)


def test_what_glows_encloses_the_scene():
    scene = under_clouds(plate(), Light(level="daylight").lighting(), WAVELENGTH_NM, seed=2)
    assert scene.lighting is None
    for name in ("sky", "sun"):
        (mesh,) = scene.assets[name].parts.values()
        assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(DOME_M, rel=0.011)
        # Emission leaves toward the camera.
        assert (np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles_center) < 0).all()
