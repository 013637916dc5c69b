"""Skies that differ from direction to direction, against closed forms.

Radiance 1 + x toward the direction (x, y, z) gives a plane with normal n the irradiance
∫ (1 + n'x) (d·n)⁺ dω = π + (2π/3) nₓ, and even light L the irradiance πL.

Surfaces as Mitsuba has them, in both kinds of variants, against Lambert's law.
"""

import math

import numpy as np
import pytest
import trimesh

from megalopta.render import RenderSettings, SceneRenderer, Variant, activate, choose_variant, mi
from megalopta.render.loading.meshes import merge
from megalopta.render.loading.scene import load_scene
from megalopta.scenes import PerspectiveCamera, Trajectory
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.scene import Lighting, SkyPattern, pattern_directions
from megalopta.scenes.spectra.spectrum import Spectrum, flat

from ..conftest import INTEGRATORS, quad, scene_of, square

BANDS = ((500.0, 600.0), (1400.0, 1500.0))
ROWS = 90
RED, BLUE = Spectrum((500.0, 1500.0), (1e-9, 3e-9)), Spectrum((500.0, 1500.0), (4e-9, 2e-9))
IN_BANDS = [[each(np.linspace(*band, 1001)).mean() for band in BANDS] for each in (RED, BLUE)]
ALONG_X, UPWARD = (1 + pattern_directions(ROWS)[..., axis] for axis in (0, 2))
SKY = Lighting(
    flat(1e-9),
    patterns=(
        SkyPattern(RED, ALONG_X.astype(np.float32)),
        SkyPattern(BLUE, UPWARD.astype(np.float32)),
    ),
)
ALBEDO, THROUGH = 0.5, 0.3


def wall(lighting, tilt_deg):
    """A leaf with its normal in the plane of x and z, from +x upward by the tilt, and its view."""
    tilt = math.radians(tilt_deg)
    normal = np.array([math.cos(tilt), 0, math.sin(tilt)])
    up = np.array([-math.sin(tilt), 0, math.cos(tilt)])
    side = np.array([0, 1.0, 0])
    corners = [a * side + b * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    leaf = Material(flat(ALBEDO), transmittance=flat(THROUGH))
    scene = scene_of(lighting, (quad(np.array(corners)), leaf))
    look = Trajectory(
        frames=2, position_m=tuple(4 * normal), look_at_m=(0, 0, 0), up=tuple(up)
    ).poses()
    return scene, look, normal


def rendered(scene, poses, integrator="path", width=8, fov_deg=10.0, samples=256):
    settings = RenderSettings(
        bands_nm=BANDS, samples_per_pixel=samples, max_depth=2, integrator=integrator
    )
    camera = PerspectiveCamera(width=width, height=width, fov_deg=fov_deg)
    return SceneRenderer(scene, camera, settings, poses).radiance(poses[0], 1)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("tilt_deg", [0, 50, 180])
def test_a_leaf_shows_both_of_its_sides_share_of_the_sky(integrator, tilt_deg):
    scene, poses, normal = wall(SKY, tilt_deg)
    found = rendered(scene, poses, integrator).mean(axis=(0, 1), dtype=np.float64)
    expected = np.zeros(len(BANDS))
    for share, facing in ((ALBEDO, normal), (THROUGH, -normal)):
        expected += share * 1e-9
        for spectrum, axis in zip(IN_BANDS, (0, 2), strict=True):
            expected += share * np.array(spectrum) * (1 + 2 / 3 * facing[axis])
    # 16 000 paths, whose values scatter by less than their mean: σ of 0.6 %.
    np.testing.assert_allclose(found, expected, rtol=0.03 if integrator == "path" else 0.02)


def test_the_sky_itself_is_the_sum_of_its_patterns():
    scene, _, _ = wall(SKY, 0)
    looking = Trajectory(frames=2, position_m=(0, 5, 0), look_at_m=(2, 9, 3)).poses()
    toward = np.array([2, 4, 3]) / np.linalg.norm([2, 4, 3])
    found = rendered(scene, looking, fov_deg=1.0).mean(axis=(0, 1), dtype=np.float64)
    expected = np.full(2, 1e-9)
    for spectrum, axis in zip(IN_BANDS, (0, 2), strict=True):
        expected += np.array(spectrum) * (1 + toward[axis])
    # 16 000 paths, whose four wavelengths fall into either band by chance: σ of 0.4 %.
    np.testing.assert_allclose(found, expected, rtol=0.02)


RNG = np.random.default_rng(3)
COUNT = 256
WAVELENGTHS = (450.0, 500.0, 550.0, 600.0)
RISING = Spectrum((400.0, 700.0), (0.1, 0.4))
VARIANTS = sorted({"scalar_spectral", choose_variant().name})
LEAVES = {
    "plain": Material(RISING, transmittance=flat(0.3)),
    "light through alone": Material(flat(0.0), transmittance=flat(0.9)),
    "nothing lost": Material(flat(0.35), transmittance=flat(0.65)),
    "black": Material(flat(0.0), Texture(np.zeros((2, 2), np.float32), flat(0.0), flat(0.5))),
    "textured": Material(
        RISING, Texture(np.full((2, 2), 0.25, np.float32), flat(0.1), RISING), None, flat(0.5)
    ),
    "opaque": Material(RISING),
}


@pytest.fixture(params=VARIANTS)
def variant(request):
    activate(Variant(request.param, "as asked"))
    yield request.param
    activate(choose_variant())


def shares(material):
    """Reflectance and transmittance (2, 4) at the wavelengths, in the middle of a surface."""
    first, texture = (material.reflectance, material.transmittance), material.texture
    weight = float(texture.weight[0, 0]) if texture else 0.0
    second = (texture.reflectance, texture.transmittance) if texture else first
    values = [[(each or flat(0.0))(WAVELENGTHS) for each in pair] for pair in (first, second)]
    return (1 - weight) * np.array(values[0]) + weight * np.array(values[1])


def loaded(material):
    sheet = square(half_width=1)
    sheet.visual = trimesh.visual.TextureVisuals(uv=np.full((4, 2), 0.5))
    scene = scene_of(None, (sheet, material))
    return load_scene(scene, merge(scene))


def directions(count):
    toward = RNG.normal(size=(3, count))
    return toward / np.linalg.norm(toward, axis=0)


def scattered(scene, origins, leaving, is_scalar):
    """Value (n, 4) and density (n,) of light that meets the middle of a surface, and leaves it."""
    surface, context = scene.shapes()[0].bsdf(), mi.BSDFContext()

    def of(ray, to):
        point = scene.ray_intersect(ray)
        return [np.array(value) for value in surface.eval_pdf(context, point, point.to_local(to))]

    if is_scalar:
        rays = [mi.Ray3f(o.tolist(), (-o).tolist(), 0.0, WAVELENGTHS) for o in origins.T]
        pairs = zip(rays, leaving.T.tolist(), strict=True)
        values, density = zip(*(of(*pair) for pair in pairs), strict=True)
        return np.array(values), np.array(density)
    wavelengths = mi.Spectrum(*WAVELENGTHS)
    rays = mi.Ray3f(mi.Point3f(origins), mi.Vector3f(-origins), 0, wavelengths)
    values, density = of(rays, mi.Vector3f(leaving))
    return values.T, density


@pytest.mark.parametrize("name", LEAVES)
def test_light_leaves_both_sides_of_a_surface_by_lamberts_law(name, variant):
    scene, expected = loaded(LEAVES[name]), shares(LEAVES[name])
    arriving, leaving = directions(COUNT), directions(COUNT)
    values, density = scattered(scene, arriving, leaving, variant.startswith("scalar"))
    same = arriving[2] * leaving[2] > 0
    law = np.where(same[:, None], *expected[:, None]) * np.abs(leaving[2] / np.pi)[:, None]
    np.testing.assert_allclose(values, law, rtol=1e-5, atol=1e-8)
    assert (density[(law > 0).any(axis=1)] > 0).all()
