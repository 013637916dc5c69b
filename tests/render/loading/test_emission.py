"""Glowing surfaces: their radiance, and their pattern where geometry says it must appear."""

import numpy as np
import pytest
import trimesh

from megalopta.render.scene_renderer import SceneRenderer
from megalopta.render.settings import RenderSettings
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.spectra.spectrum import flat
from megalopta.scenes.trajectories.steady import Trajectory

from ..conftest import quad, scene_of

BANDS = ((400.0, 450.0), (450.0, 600.0), (600.0, 700.0), (900.0, 1000.0))
CAMERA = PerspectiveCamera(width=48, height=36, fov_deg=60)
INSIDE = Trajectory(frames=1, position_m=(0, 0, 0), look_at_m=(1, 0, 0))
OUTSIDE = Trajectory(frames=1, position_m=(-1.5, 0, 0), look_at_m=(1, 0, 0))


def glowing(mesh, pattern=None, radiance=3e-6):
    mesh.visual = trimesh.visual.TextureVisuals(uv=mesh.metadata.get("uv", mesh.vertices[:, :2]))
    return scene_of(None, (mesh, Material(flat(0.0), None, Emission(radiance, pattern))))


def rendered(scene, trajectory, samples, backend="auto"):
    settings = RenderSettings(
        samples_per_pixel=samples, bands_nm=BANDS, max_depth=2, backend=backend
    )
    return SceneRenderer(scene, CAMERA, settings).radiance(trajectory.poses()[0], seed=1)


@pytest.mark.parametrize("pattern", [None, np.full((8, 8), 0.5, np.float32)], ids=["even", "half"])
@pytest.mark.parametrize(
    ("trajectory", "is_inward"), [(INSIDE, True), (OUTSIDE, False)], ids=["inward", "outward"]
)
def test_a_glowing_wall_reads_its_radiance_in_every_band(trajectory, is_inward, pattern):
    box = trimesh.creation.box((1, 9, 9))
    if is_inward:
        box.invert()
    means = rendered(glowing(box, pattern), trajectory, 1024).mean(axis=(0, 1), dtype=np.float64)
    # 1.8 million paths of four wavelengths over four bands leave less than 0.02 % noise.
    np.testing.assert_allclose(means, 3e-6 * (1 if pattern is None else 0.5), rtol=1e-3)


@pytest.mark.parametrize("backend", ["auto", "scalar"])
def test_a_pattern_has_row_0_at_v_0_and_its_columns_along_u(backend):
    # A wall x = 5 seen from the origin: y runs left, so u = 0 at y = 5 puts u to the right.
    wall = quad(np.array([[5, 5, -5], [5, -5, -5], [5, -5, 5], [5, 5, 5.0]]))
    wall.metadata["uv"] = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    rows, columns = np.mgrid[:64, :64]
    # Linear in u and v, which the interpolation between texels keeps exactly.
    pattern = (0.5 + (columns + 0.5) / 64 + 0.3 * (rows + 0.5) / 64).astype(np.float32)
    image = rendered(glowing(wall, pattern), INSIDE, 256, backend).mean(axis=-1) / 3e-6
    directions = CAMERA.directions()
    right, down = (5 * directions[..., i] / directions[..., 2] for i in (0, 1))
    expected = 0.5 + (0.5 + right / 10) + 0.3 * (0.5 - down / 10)
    # A shift of half a pixel across or down would move the mean by 0.006 or 0.0018.
    assert np.mean(image - expected) == pytest.approx(0, abs=6e-4)
    np.testing.assert_allclose(image, expected, rtol=0.02)
