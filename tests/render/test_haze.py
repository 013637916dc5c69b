"""Haze against closed forms, a quadrature and furnaces.

Tolerances are five standard errors or more of the paths traced: by chance one such comparison fails
once in two million times.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.special import expn

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import EquirectangularCamera, Haze, PerspectiveCamera, Shutter, Trajectory
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.scene import Lighting, Sun
from megalopta.scenes.spectra.spectrum import flat, luminous

from .conftest import quad, scene_of, square

LEVEL = 2e-9
BANDS = ((500.0, 600.0), (1400.0, 1500.0))
AHEAD = Trajectory(frames=2, position_m=(0, 0, 0), look_at_m=(1, 0, 0), frame_rate_hz=1)
POSES = AHEAD.poses()


def wall(distance_m, half_m):
    corners = half_m * np.array([[0, 1, -1], [0, -1, -1], [0, -1, 1], [0, 1, 1]])
    return quad(corners + np.array([distance_m, 0, 0]))


def hazy(mesh, material, haze, sky=LEVEL, motion=None):
    return scene_of(Lighting(flat(sky)) if sky else None, (mesh, material, motion), haze=haze)


def renderer(scene, fov_deg=2.0, samples=256, width=64, backend="auto", camera=None):
    settings = RenderSettings(
        bands_nm=BANDS, samples_per_pixel=samples, max_depth=2, backend=backend
    )
    camera = camera or PerspectiveCamera(width=width, height=width, fov_deg=fov_deg)
    return SceneRenderer(scene, camera, settings, POSES)


def mean(rendering):
    return rendering.radiance(POSES[0], 1).mean(axis=(0, 1), dtype=np.float64)


@pytest.mark.parametrize(("share", "tolerance"), [(0.25, 0.004), (1.0, 0.025)])
def test_what_glows_fades_exponentially_to_two_percent_at_the_visibility(share, tolerance):
    haze = Haze(visibility_m=40, albedo=0)
    board = hazy(wall(40 * share, 5), Material(flat(0), None, Emission(LEVEL)), haze, sky=0)
    # Of half a million paths in each band a share T escapes: 0.05 and 0.3 % (σ) when stratified.
    assert mean(renderer(board)) == pytest.approx(LEVEL * 0.02**share, rel=tolerance)


@pytest.mark.parametrize("asymmetry", [-0.6, 0.6])
def test_light_scattered_once_is_that_of_a_quadrature(asymmetry):
    """Before a black wall, of droplets that absorb nearly all: twice is 0.2 % of once."""
    distance, half, visibility, albedo = 10.0, 6.0, 30.0, 0.002
    haze = Haze(visibility_m=visibility, albedo=albedo, asymmetry=asymmetry)
    view = renderer(hazy(wall(distance, half), Material(flat(0)), haze), 0.5, samples=100)
    found = mean(view)
    expected = LEVEL * albedo * scattered_once(distance, half, haze.extinction_per_m, asymmetry)
    # 410 000 paths: 0.2 % (σ).
    assert found == pytest.approx(expected, rel=0.015)


def scattered_once(distance, half, extinction, g):
    """∫ σ·exp(−σs) ∫ p·exp(−σℓ) dω ds along the view, without directions that meet the wall.

    The box reaches 1 m beyond wall and camera; ℓ is the way to its end.
    """
    nodes, weights = np.polynomial.legendre.leggauss(12)
    cosine = (np.arange(200) + 0.5) / 100 - 1
    azimuth = 2 * np.pi * (np.arange(200) + 0.5) / 200
    sine = np.sqrt(1 - cosine**2)
    x = np.repeat(cosine[:, None], 200, axis=1)
    toward = np.stack([x, np.outer(sine, np.cos(azimuth)), np.outer(sine, np.sin(azimuth))], -1)
    phase = (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * x) ** 1.5)
    low, high = np.array([-1, -half - 1, -half - 1]), np.array([distance + 1, half + 1, half + 1])
    total = 0.0
    for way, weight in zip(distance * (nodes + 1) / 2, weights * distance / 2, strict=True):
        point = np.array([way, 0, 0])
        ends = np.maximum((low - point) / toward, (high - point) / toward).min(axis=-1)
        across = (distance - way) / x[..., None] * toward[..., 1:]
        free = (x < 0) | (np.abs(across).max(axis=-1) > half)
        light = (phase * free * np.exp(-extinction * ends)).mean() * 4 * np.pi
        total += weight * extinction * np.exp(-extinction * way) * light
    return total


SPHERE = trimesh.creation.icosphere(subdivisions=3).apply_translation((4, 0, 0))
CAMERAS = [
    PerspectiveCamera(width=32, height=32, fov_deg=40),
    EquirectangularCamera(width=32, height=16),
]


@pytest.mark.parametrize(
    ("camera", "exposure_s"), [*zip(CAMERAS, [0.5, 0], strict=True)], ids=["exposed", "panorama"]
)
def test_nothing_is_seen_where_droplets_and_surfaces_scatter_all_of_an_even_light(
    camera, exposure_s
):
    """Paths of 66 hits and scatterings at most miss nothing that 1000 would find."""
    scene = hazy(SPHERE, Material(flat(1)), Haze(visibility_m=10))
    rendering = renderer(scene, samples=64, camera=camera)
    if exposure_s:
        image = rendering.exposed(AHEAD, Shutter(exposure_s=exposure_s), 0, 1)
    else:
        image = rendering.radiance(POSES[0], 1)
    # 16 000 paths or more in each band: 0.2 % (σ).
    assert image.mean(axis=(0, 1), dtype=np.float64) == pytest.approx(LEVEL, rel=0.012)


def test_meter_reads_the_requested_light_above_the_haze_and_what_is_left_of_it_below():
    """Of a beam exp(−τ), of an even sky 2·E₃(τ), where droplets only absorb."""
    haze = Haze(visibility_m=20, albedo=0)
    sun = Sun((0, 0, 1), flat(LEVEL))
    scene = hazy(square(), Material(flat(0)), haze)
    depth = 4 * haze.extinction_per_m  # the box ends 1 m above the camera
    for lighting, unshaded, share in (
        (Lighting(flat(0.0), sun), LEVEL, math.exp(-depth)),
        (Lighting(flat(LEVEL)), math.pi * LEVEL, 2 * expn(3, depth)),
    ):
        lit, eye = replace(scene, lighting=lighting), np.array([[0.0, 0, 3]])
        camera = PerspectiveCamera(width=4, height=4)
        poses = POSES + np.pad([[3.0]], ((2, 1), (3, 0)))
        survey = SceneRenderer(lit, camera, RenderSettings(), poses).light_survey(eye)
        lux = luminous(flat(unshaded))
        assert survey.unshaded.lux == pytest.approx(lux, rel=1e-3)
        # 102 400 paths: 0.5 % (σ); the meter is 2 cm above the ground.
        assert survey.ground[0].lux == pytest.approx(share * lux, rel=0.03)
