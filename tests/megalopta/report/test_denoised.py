"""Light denoised for display."""

import numpy as np
import pytest

from megalopta.config.model import Configuration
from megalopta.report import denoised as module
from megalopta.report.denoised import denoised, pixel_albedo
from megalopta.stages.render import build

CAMERA = {"width": 96, "height": 64, "fov_deg": 75}


def albedo_of(scene):
    settings = Configuration.model_validate({"scene": scene, "camera": CAMERA})
    return pixel_albedo(build(settings), settings, settings.trajectory.poses()[0])


@pytest.fixture(scope="module")
def albedo():
    return albedo_of({"kind": "forest", "preset": "open", "trees": 8})


def test_noise_goes_and_the_mean_stays(albedo):
    """Of noise as large as the light, half is left at most. The denoiser keeps means to 3 %."""
    light = np.where(albedo > 0, 3e-4 * albedo, 1e-4) * np.linspace(0.5, 1.5, 96)[:, None]
    noisy = light * np.random.default_rng(0).exponential(1.0, (64, 96, 1))
    found = denoised(noisy.astype(np.float32), albedo)
    assert found.dtype == np.float32
    assert (found - light).std() < 0.5 * (noisy - light).std()
    np.testing.assert_allclose(found.mean((0, 1)), light.mean((0, 1)), rtol=0.03)


def test_without_the_denoiser_light_stays_as_rendered(albedo, monkeypatch):
    monkeypatch.setattr(module, "denoise", None)
    assert denoised(albedo, albedo) is albedo


def test_surfaces_that_glow_stay_as_rendered():
    light = np.ones((64, 96, 4), np.float32)
    assert denoised(light, albedo_of({"kind": "grating"})) is light


def test_albedo_is_the_mean_over_the_pixel(albedo):
    """Leaves are smaller than pixels, so that few pixels have the albedo of one material."""
    assert albedo.shape == (64, 96, 4)
    assert len(np.unique(albedo[..., 1].round(6))) > 100
