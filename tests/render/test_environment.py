"""Panoramas seen by a camera, and as the light of a scene."""

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from megalopta.render import RenderSettings, SceneRenderer, environment
from megalopta.scenes import Light, Panorama, PerspectiveCamera, Trajectory, build_scene
from megalopta.scenes.moving_objects import MovingObject
from megalopta.scenes.scene import pattern_directions
from megalopta.scenes.spectra.spectrum import luminous

from .conftest import scene_of, square

BANDS = ((400.0, 475.0), (475.0, 550.0), (550.0, 625.0), (625.0, 700.0))
CAMERA = PerspectiveCamera(width=33, height=25, fov_deg=60)
LIGHT = Light(level="full_moon")
LEVEL = LIGHT.resolved()
STAND = Trajectory()


def noise(rows=32, seed=0):
    return np.random.default_rng(seed).gamma(0.5, size=(rows, 2 * rows, 3)).astype(np.float32)


def renderer(path, turn_deg=0.0, samples=9, camera=CAMERA):
    scene = Panorama(file=path, turn_deg=turn_deg).build(LIGHT, camera, STAND)
    return SceneRenderer(scene, camera, RenderSettings(samples_per_pixel=samples, bands_nm=BANDS))


def pose(azimuth_deg=0.0, elevation_deg=0.0):
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    look = math.cos(azimuth), math.sin(azimuth), math.tan(elevation)
    return Trajectory(frames=2, position_m=(0, 0, 0), look_at_m=look).poses()[0]


@pytest.mark.parametrize("name", ["white.exr", "white.hdr", "white.png"])
def test_white_picture_has_the_radiance_of_a_uniform_sky_of_the_level(picture, name):
    image = renderer(picture(np.full((8, 16, 3), 0.5), name)).radiance(pose(40, 20), 0)
    spectrum = LEVEL.spectrum()
    expected = [spectrum(np.linspace(*band, 1001)).mean() / math.pi for band in BANDS]
    # The level's table has corners every 10 nm, the primaries' every 5; float32 pixels.
    np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=2e-3)


def test_upper_half_gives_the_requested_illuminance_measured_along_rays(picture):
    # Band-limited enough for bilinear reading: noise averaged over 8 × 8 pixels.
    values = np.kron(noise(16), np.ones((8, 8, 1)))
    panorama = Panorama(file=picture(values)).build(LIGHT, CAMERA, STAND).environment
    number = np.arange(2**16)
    radius, turn = np.sqrt((number + 0.5) / 2**16), number * np.pi * (3 - np.sqrt(5))
    upward = radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - radius**2)
    colors = environment.look_up(environment.load_panorama(panorama), np.stack(upward, -1))
    lux = (
        math.pi
        * colors.mean(axis=0)
        @ np.array([luminous(spectrum) for spectrum in panorama.spectra])
    )
    assert lux == pytest.approx(LEVEL.illuminance_lux, rel=5e-3)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 0), (90, 0), (-135, 30)])
def test_a_bright_spot_is_seen_where_it_is_in_the_picture(picture, azimuth, elevation):
    rows = 256
    values = np.full((rows, 2 * rows, 3), 1e-3)
    row = round((90 - elevation) / 180 * rows)
    column = round((180 - azimuth) / 360 * 2 * rows)  # +x at the center, left is counterclockwise
    values[row - 1 : row + 1, np.arange(column - 1, column + 1) % (2 * rows)] = 1e3
    image = renderer(picture(values)).radiance(pose(azimuth, elevation), 0)[..., 0]
    assert np.unravel_index(image.argmax(), image.shape) == (12, 16)  # the center pixel


def test_a_moving_camera_sees_and_says_rotation_alone(picture):
    trajectory = Trajectory(
        frames=2, frame_rate_hz=1, rotation_deg_s=5, velocity_m_s=(3, 1, 2), position_m=(0, 0, 1.5)
    )
    poses, view = trajectory.poses(), renderer(picture(noise()))
    truth = view.truth(poses, 0)
    # Independent: directions turned back by 5° about the vertical image axis, then projected.
    turned = CAMERA.directions() @ Rotation.from_euler("y", 5, degrees=True).as_matrix().T
    x = turned[..., 0] / turned[..., 2] * CAMERA.focal_length_px + CAMERA.width / 2
    expected = x - CAMERA.pixel_centers()[..., 0]
    np.testing.assert_allclose(truth.flow_forward[..., 0], expected, atol=1e-4)
    assert np.isinf(truth.depth).all()
    still = poses[1].copy()
    still[:3, 3] = poses[0][:3, 3]
    assert view.radiance(poses[1], 0).tobytes() == view.radiance(still, 0).tobytes()


def test_objects_before_a_panorama_are_lit_by_it_and_move_on_their_own(picture):
    """Closed form: under a uniform picture a plain ball has reflectance × radiance everywhere."""
    ball = MovingObject(
        shape="ball", position_m=(3, 0, 0), pattern="plain", reflectances=(0.4, 0.4)
    )
    ahead = {"position_m": (0, 0, 0), "look_at_m": (1, 0, 0), "velocity_m_s": (0, 0.1, 0)}
    path = Trajectory(frames=2, frame_rate_hz=1, rotation_deg_s=0, **ahead)
    around = Panorama(file=picture(np.ones((8, 16, 3))))
    scene = build_scene(around, LIGHT, CAMERA, path, [ball])
    settings = RenderSettings(samples_per_pixel=16, bands_nm=BANDS[:1], integrator="plain")
    view = SceneRenderer(scene, CAMERA, settings)
    light, truth = view.radiance(path.poses()[0], 0)[..., 0], view.truth(path.poses(), 0)
    assert light[12, 16] / light[0, 0] == pytest.approx(0.4, rel=0.02)
    # the nearest point, 2.75 m away, moves 0.1 m to the right; what is at infinity rests
    near, far = truth.flow_forward[12, 16], truth.flow_forward[0, 0]
    assert near == pytest.approx([CAMERA.focal_length_px * 0.1 / 2.75, 0], abs=1e-3)
    assert far == pytest.approx([0, 0], abs=1e-6)


def test_pixels_are_means_over_their_area_whatever_the_strips(picture, monkeypatch):
    path = picture(noise())
    whole = renderer(path, samples=16).radiance(pose(10, 5), 0)
    monkeypatch.setattr("megalopta.render.environment.POINTS_AT_ONCE", 1)
    np.testing.assert_array_equal(renderer(path, samples=16).radiance(pose(10, 5), 0), whole)
    fine = CAMERA.model_copy(update={"width": CAMERA.width * 4, "height": CAMERA.height * 4})
    points = renderer(path, samples=1, camera=fine).radiance(pose(10, 5), 0)
    blocks = points.reshape(CAMERA.height, 4, CAMERA.width, 4, len(BANDS)).mean(axis=(1, 3))
    np.testing.assert_allclose(whole, blocks, rtol=1e-5)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (np.ones((8, 8, 3)), "8 × 8 pixels; a panorama is twice as wide"),
        (np.full((8, 16, 3), -1.0), "values below 0, the lowest -1, more than 1% of its"),
        (np.zeros((8, 16, 3)), "black above the horizon"),
    ],
)
def test_pictures_that_are_no_panorama_of_light_are_refused(picture, values, reason):
    with pytest.raises(ValueError, match=reason):
        renderer(picture(values))


ROWS = 64
WEIGHTS = np.array([0.2, 0.7, 0.1])


def landscape(seed=0):
    """A smooth picture (H, 2·H, 3) whose light comes from all over."""
    noise = np.random.default_rng(seed).normal(size=(ROWS, 2 * ROWS, 3))
    smooth = gaussian_filter(noise, (3, 3, 0), mode=("nearest", "wrap", "nearest"))
    return np.exp(smooth / smooth.std() / 2).astype(np.float32)


def with_sun(azimuth_deg, elevation_deg, irradiance):
    """The same with a Gaussian sun, half a degree wide, on a finer picture."""
    picture = np.kron(landscape(), np.ones((8, 8, 1))).astype(np.float32)
    rows, columns = picture.shape[:2]
    a, h = math.radians(azimuth_deg), math.radians(elevation_deg)
    toward = np.array([math.cos(h) * math.cos(a), math.cos(h) * math.sin(a), math.sin(h)])
    angle = np.degrees(np.arccos(np.clip(pattern_directions(rows) @ toward, -1, 1)))
    disc = np.exp(-((angle / 0.5) ** 2))
    disc /= (disc * environment.solid_angles(rows, columns)[:, None]).sum()
    return picture + (disc[..., None] * irradiance).astype(np.float32), toward


def scene_under(path, **light):
    return scene_of(Light(panorama=str(path), **light).lighting(), square(half_width=1))


def test_a_sun_is_taken_out_with_its_direction_and_all_of_its_light():
    irradiance = np.array([60.0, 50.0, 40.0])
    picture, toward = with_sun(130, 35, irradiance)
    left, direction, found = environment.without_disc(picture, WEIGHTS)
    assert np.degrees(np.arccos(np.dot(direction, toward))) < 0.1
    # The sky behind it differs from the ring's mean by a few units over 3°: 0.01 of irradiance.
    np.testing.assert_allclose(found, irradiance, rtol=2e-3)
    given = environment.horizontal(left) + found * direction[2]
    np.testing.assert_allclose(given, environment.horizontal(picture), rtol=1e-3)
    assert left.max() < picture.max() / 50


def test_the_picture_behind_a_scene_is_the_one_looked_at_alone(picture):
    path = picture(landscape())
    camera = PerspectiveCamera(width=24, height=16, fov_deg=70)
    settings = RenderSettings(bands_nm=BANDS[:2], samples_per_pixel=256, integrator="path")
    looking = Trajectory(frames=2, position_m=(0, 0, 1.5), look_at_m=(1, 2, 2.5)).poses()
    lit = SceneRenderer(scene_under(path, panorama_turn_deg=40), camera, settings)
    light = Light()
    alone = SceneRenderer(
        Panorama(file=path, turn_deg=40).build(light, camera, STAND), camera, settings
    )
    a, b = (each.radiance(looking[0], 1) for each in (lit, alone))
    # 256 wavelengths a band and pixel: σ below 2 %; a turn by parts of a texel smooths a little.
    np.testing.assert_allclose(a, b, rtol=0.12)
    assert a.mean() == pytest.approx(b.mean(), rel=3e-3)


@pytest.mark.parametrize("elevation_deg", [20, 60])
def test_the_light_meter_reads_the_level_with_a_sun_in_the_picture(picture, elevation_deg):
    values, toward = with_sun(130, elevation_deg, np.array([60.0, 50.0, 40.0]))
    scene = scene_under(picture(values), level="daylight")
    camera = PerspectiveCamera(width=8, height=8)
    renderer = SceneRenderer(scene, camera, RenderSettings(max_depth=3))
    survey = renderer.light_survey(np.array([[0.0, 0.0, 3.0]]))
    unshaded = survey.unshaded
    assert abs(unshaded.lux - 1e5) < 6 * unshaded.standard_error_lux + 3e-3 * 1e5  # table of V(λ)
    sun = environment.under_panorama(scene).lighting.sun
    assert np.degrees(np.arccos(np.dot(sun.direction, toward))) < 0.1
