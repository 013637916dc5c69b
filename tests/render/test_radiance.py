import math

import numpy as np
import pytest
import trimesh

from megalopta.render.scene_renderer import SceneRenderer
from megalopta.render.settings import RenderSettings, frame_seed
from megalopta.render.variant import choose_variant
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.lighting.light import Light
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.scene import Lighting, Scene, Sun
from megalopta.scenes.spectra.reflectance import reflectance_of
from megalopta.scenes.spectra.spectrum import Spectrum, flat
from megalopta.scenes.trajectories.steady import Trajectory

from .conftest import placed

BANDS = ((400.0, 450.0), (450.0, 500.0), (500.0, 600.0), (600.0, 700.0), (900.0, 1000.0))
SLOPED = Spectrum((300.0, 500.0, 700.0, 1100.0), (1e-9, 2e-9, 4e-9, 4e-9))
LOOKING_DOWN = Trajectory(
    frames=2, position_m=(0, 0, 2), look_at_m=(0, 0, 0), up=(1, 0, 0)
).poses()[0]


def band_means(spectrum, bands=BANDS):
    """Independent of the renderer: fine midpoint sums."""
    grids = [np.linspace(a, b, 20001) for a, b in bands]
    return np.array([spectrum(0.5 * (grid[1:] + grid[:-1])).mean() for grid in grids])


def mean_radiance(scene, samples=64, width=160, bands=BANDS, integrator="auto"):
    camera = PerspectiveCamera(width=width, height=width, fov_deg=40)
    settings = RenderSettings(samples_per_pixel=samples, bands_nm=bands, integrator=integrator)
    renderer = SceneRenderer(scene, camera, settings, LOOKING_DOWN[np.newaxis])
    image = renderer.radiance(LOOKING_DOWN, seed=1)
    return image.mean(axis=(0, 1), dtype=np.float64)


def test_constant_emitter_reads_its_radiance_in_every_band():
    scene = Scene({}, {}, (), Lighting(SLOPED))
    # 1.6 million paths of 4 wavelengths over 5 bands leave less than 0.02 % noise.
    np.testing.assert_allclose(mean_radiance(scene), band_means(SLOPED), rtol=1e-3)


def test_diffuse_plane_under_uniform_sky_returns_reflectance_times_irradiance_over_pi(ground):
    _, assets, placements = placed(ground)
    leaf = Spectrum((400.0, 550.0, 700.0, 750.0), (0.05, 0.12, 0.06, 0.5))
    scene = Scene({"thing": Material(leaf)}, assets, placements, Lighting(flat(2e-9)))
    expected = band_means(leaf) * 2e-9  # E = πL, so ρE/π = ρL
    np.testing.assert_allclose(mean_radiance(scene), expected, rtol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "width"), [("path", 160), ("baked", 72)])
@pytest.mark.parametrize(
    "light",
    [
        Light(level="airglow"),
        Light(level="quarter_moon"),
        Light(level="daylight", cloud_cover=0.5),
    ],
    ids=lambda light: light.level,
)
def test_diffuse_plane_returns_reflectance_times_irradiance_of_all_lights_over_pi(
    ground, light, integrator, width
):
    if integrator == "baked" and choose_variant().name.startswith("scalar"):
        pytest.skip("baking needs a vectorized variant")
    # Mitsuba's own range ends at 830 nm; lines and water bands make both factors uneven.
    bands = ((400.0, 700.0), (700.0, 900.0), (900.0, 1100.0), (1100.0, 1400.0), (1400.0, 1700.0))
    _, assets, placements = placed(ground)
    leaf, together = reflectance_of("leaf light"), light.resolved().spectrum()
    scene = Scene({"thing": Material(leaf)}, assets, placements, light.lighting())
    expected = band_means(lambda nm: leaf(nm) * together(nm) / math.pi, bands)
    found = mean_radiance(scene, width=width, bands=bands, integrator=integrator)
    # Paths take 1.6 million wavelengths of a band over which light may change by a factor of ten;
    # baked light of more than 4000 pixels is tried on a part of them.
    np.testing.assert_allclose(found, expected, rtol=5e-3)


def test_diffuse_plane_under_the_sun_follows_the_cosine_law(ground):
    _, assets, placements = placed(ground)
    direction = (math.sin(1.0), 0.0, math.cos(1.0))
    light = Lighting(flat(0.0), Sun(direction, flat(3e-6)))
    scene = Scene({"thing": Material(flat(0.4))}, assets, placements, light)
    expected = 0.4 * 3e-6 * math.cos(1.0) / math.pi
    np.testing.assert_allclose(mean_radiance(scene), expected, rtol=5e-3)


def test_texture_mixes_the_two_reflectances_by_its_weight(ground):
    ground.visual = trimesh.visual.TextureVisuals(uv=np.zeros((4, 2)))
    _, assets, placements = placed(ground)
    weight = np.full((4, 4), 0.25, np.float32)
    material = Material(flat(0.2), Texture(weight, flat(0.6)))
    scene = Scene({"thing": material}, assets, placements, Lighting(flat(1e-9)))
    np.testing.assert_allclose(mean_radiance(scene), 0.3e-9, rtol=5e-3)


def test_radiance_is_linear_in_the_light(ground):
    materials, assets, placements = placed(ground)
    dim, bright = (
        mean_radiance(Scene(materials, assets, placements, Lighting(flat(level))), 4, 32)
        for level in (1e-9, 4e-9)
    )
    # The same seed draws the same paths: only float32 rounding differs.
    np.testing.assert_allclose(bright, 4 * dim, rtol=1e-5)


def test_same_seed_gives_same_bytes_and_another_seed_other_noise(ground):
    materials, assets, placements = placed(ground)
    scene = Scene(materials, assets, placements, Lighting(SLOPED))
    renderer = SceneRenderer(
        scene, PerspectiveCamera(width=16, height=16), RenderSettings(samples_per_pixel=4)
    )
    first, again, other = (renderer.radiance(LOOKING_DOWN, seed) for seed in (5, 5, 6))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()


def test_frame_seeds_do_not_collide_between_sequences():
    seeds = {frame_seed(seed, frame) for seed in range(20) for frame in range(50)}
    assert len(seeds) == 1000


@pytest.mark.parametrize(
    ("sampler", "effective"), [("independent", 4095), ("orthogonal", 4489), ("ldsampler", 4096)]
)
def test_samples_are_told_as_the_sampler_rounds_them(sampler, effective):
    settings = RenderSettings(samples_per_pixel=4095, sampler=sampler)
    scene = Scene({}, {}, (), Lighting(flat(1.0)))
    camera = PerspectiveCamera(width=16, height=16)
    assert SceneRenderer(scene, camera, settings).samples_per_pixel == effective


def test_bands_that_would_share_a_channel_are_refused_before_rendering():
    with pytest.raises(ValueError, match="400-500 and 425-475 nm share a center"):
        RenderSettings(bands_nm=((400, 500), (425, 475)))


def test_bands_with_swapped_edges_are_refused():
    with pytest.raises(ValueError, match=r"\[500, 400\] is not a band"):
        RenderSettings(bands_nm=((500, 400),))
