"""Motion blur and rolling shutter against closed forms on a wall parallel to the image."""

import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer
from megalopta.scenes import PerspectiveCamera, Shutter, Trajectory
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.motion import Drift, RigidMotion
from megalopta.scenes.spectra.spectrum import flat

from .conftest import quad, scene_of

CAMERA = PerspectiveCamera(width=80, height=60, fov_deg=60)
SETTINGS = RenderSettings(samples_per_pixel=64, bands_nm=((500, 600),), max_depth=1)
FOCAL = 80 / 2 / np.tan(np.radians(30))
DISTANCE = 5.0
SPEED = 3.0
PX_PER_S = FOCAL * SPEED / DISTANCE


def half_wall(motion=None):
    """A glowing half plane x = 5, y < 0: in the image its edge is vertical, light to its right."""
    wall = quad(np.array([[5, 0, -50], [5, -50, -50], [5, -50, 50], [5, 0, 50.0]]))
    return scene_of(None, (wall, Material(flat(0.0), None, Emission(1e-6)), motion))


def sliding(velocity, frames=3):
    return Trajectory(
        frames=frames, position_m=(0, 0, 0), look_at_m=(1, 0, 0), velocity_m_s=velocity
    )


def edges(image):
    """Where the edge is in each row (px): the width of the dark part, which is to the left."""
    assert (image[:, 0] < image[:, -1]).all()
    return CAMERA.width - image[..., 0].sum(axis=1) / 1e-6


ALONG = sliding((0.0, SPEED, 0.0))  # the image moves to the right


def edge_at(times):
    return CAMERA.width / 2 + PX_PER_S * np.asarray(times)


# The camera goes to the left, or the wall to the right.
MOTION = RigidMotion((5.0, 0.0, 0.0), Drift(velocity_m_s=(0.0, -SPEED, 0.0)))
BOTH = pytest.mark.parametrize(
    ("path", "motion"),
    [(ALONG, None), (sliding((0.0, 0.0, 0.0)), MOTION)],
    ids=["camera moves", "object moves"],
)


@BOTH
def test_a_blurred_edge_is_a_ramp_around_its_place_at_mid_exposure(path, motion):
    renderer = SceneRenderer(half_wall(motion), CAMERA, SETTINGS)
    image = renderer.exposed(path, Shutter(exposure_s=0.08, poses=64), 1, seed=3)
    # Each of 64 samples of a pixel, at its own part of the exposure and uniform in the pixel, tells
    # where the edge is: that scatters by √(1/6/64) = 0.05 px a row.
    np.testing.assert_allclose(edges(image), edge_at(0.1), atol=0.3)
    np.testing.assert_allclose(edges(image).mean(), edge_at(0.1), atol=0.04)
    profile = image[..., 0].mean(axis=0) / 1e-6
    x = np.arange(CAMERA.width) + 0.5
    ramp = np.clip((x - edge_at(0.06)) / (edge_at(0.14) - edge_at(0.06)), 0, 1)
    np.testing.assert_allclose(profile, ramp, atol=0.07)  # pixels are a quarter of the ramp wide


def test_an_exposure_is_stratified_in_time():
    # An edge that crosses the whole frame in a twelfth of the exposure: each pixel sees the wall in
    # the samples of a known part of it, up to one at either end and one for the edge in the pixel.
    speed = 500 * SPEED
    renderer = SceneRenderer(half_wall(), CAMERA, SETTINGS)
    image = renderer.exposed(sliding((0.0, speed, 0.0)), Shutter(exposure_s=0.05), 0, seed=3)
    reach = FOCAL * speed / DISTANCE * 0.05
    x = np.arange(CAMERA.width) + 0.5 - CAMERA.width / 2
    assert np.abs(image[..., 0] / 1e-6 - (0.5 + x / reach)).max() <= 3 / 64


@BOTH
@pytest.mark.parametrize("per_pass", [None, 80 * 64 * 7], ids=["one pass", "strips of 7 rows"])
def test_every_row_of_a_rolling_shutter_shows_its_own_time(path, motion, per_pass):
    settings = SETTINGS.model_copy(update={"samples_per_pass": per_pass})
    image = SceneRenderer(half_wall(motion), CAMERA, settings).exposed(
        path, Shutter(readout_s=0.08), 1, seed=3
    )
    rows = np.arange(CAMERA.height)
    expected = edge_at(0.1 + 0.08 * (rows / (CAMERA.height - 1) - 0.5))
    np.testing.assert_allclose(edges(image), expected, atol=0.1)


@pytest.mark.parametrize(
    ("is_object", "per_pass"),
    [(False, None), (True, 60 * 64 * 7)],
    ids=["camera moves", "object moves, strips of 7 columns"],
)
def test_every_column_of_a_shutter_from_the_right_shows_its_own_time(is_object, per_pass):
    # A glowing half plane x = 5, z < 0: its edge is horizontal, light below it.
    wall = quad(np.array([[5, 50, 0], [5, 50, -50], [5, -50, -50], [5, -50, 0.0]]))
    falling = RigidMotion((5.0, 0.0, 0.0), Drift(velocity_m_s=(0.0, 0.0, -SPEED)))
    motion = falling if is_object else None
    path = sliding((0.0, 0.0, 0.0 if is_object else SPEED))
    settings = SETTINGS.model_copy(update={"samples_per_pass": per_pass})
    scene = scene_of(None, (wall, Material(flat(0.0), None, Emission(1e-6)), motion))
    shutter = Shutter(readout_s=0.08, readout_from="right")
    image = SceneRenderer(scene, CAMERA, settings).exposed(path, shutter, 1, seed=3)
    found = CAMERA.height - image[..., 0].sum(axis=0) / 1e-6
    columns = np.arange(CAMERA.width)
    times = 0.1 - 0.08 * (columns / (CAMERA.width - 1) - 0.5)
    np.testing.assert_allclose(found, CAMERA.height / 2 + PX_PER_S * times, atol=0.1)
