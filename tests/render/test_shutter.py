"""Motion blur and rolling shutter against closed forms on a wall parallel to the image.

Frames in passes: nothing lost between strips, nothing changed by repeats, Ctrl-C in between.
"""

import signal

import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer, path_tracing
from megalopta.render.film import plan_passes
from megalopta.scenes import (
    CylindricalCamera,
    EquirectangularCamera,
    PerspectiveCamera,
    Shutter,
    Trajectory,
)
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.motion import Drift, RigidMotion
from megalopta.scenes.spectra.spectrum import flat

from .conftest import glowing_room, quad, scene_of

CAMERA = PerspectiveCamera(width=80, height=60, fov_deg=60)
SETTINGS = RenderSettings(samples_per_pixel=64, bands_nm=((500, 600),), max_depth=1)
FOCAL = 80 / 2 / np.tan(np.radians(30))
DISTANCE = 5.0
SPEED = 3.0
PX_PER_S = FOCAL * SPEED / DISTANCE


# A half plane x = 5, y < 0: in the image its edge is vertical, light to its right.
HALF_WALL = np.array([[5, 0, -50], [5, -50, -50], [5, -50, 50], [5, 0, 50.0]])


def glowing(corners, motion=None):
    return scene_of(None, (quad(corners), Material(flat(0.0), None, Emission(1e-6)), motion))


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


@pytest.mark.parametrize(
    ("path", "motion"),
    [(ALONG, None), (sliding((0.0, 0.0, 0.0)), MOTION)],
    ids=["camera moves", "object moves"],
)
def test_a_blurred_edge_is_a_ramp_around_its_place_at_mid_exposure(path, motion):
    renderer = SceneRenderer(glowing(HALF_WALL, motion), CAMERA, SETTINGS)
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
    renderer = SceneRenderer(glowing(HALF_WALL), CAMERA, SETTINGS)
    image = renderer.exposed(sliding((0.0, speed, 0.0)), Shutter(exposure_s=0.05), 0, seed=3)
    reach = FOCAL * speed / DISTANCE * 0.05
    x = np.arange(CAMERA.width) + 0.5 - CAMERA.width / 2
    assert np.abs(image[..., 0] / 1e-6 - (0.5 + x / reach)).max() <= 3 / 64


# A glowing half plane x = 5, z < 0: its edge is horizontal, light below it.
UPRIGHT = np.array([[5, 50, 0], [5, 50, -50], [5, -50, -50], [5, -50, 0.0]])


@pytest.mark.parametrize("is_object", [False, True], ids=["camera moves", "object moves"])
@pytest.mark.parametrize("per_pass", [None, 80 * 64 * 7], ids=["one pass", "strips of 7 lines"])
@pytest.mark.parametrize("side", ["top", "right"])
def test_every_line_of_a_rolling_shutter_shows_its_own_time(side, is_object, per_pass):
    settings = SETTINGS.model_copy(update={"samples_per_pass": per_pass})
    course, axis = np.zeros(3), 1 if side == "top" else 2
    course[axis] = SPEED
    path = sliding(tuple(0 * course if is_object else course))
    motion = RigidMotion((5.0, 0.0, 0.0), Drift(velocity_m_s=tuple(-course))) if is_object else None
    wall = HALF_WALL if side == "top" else UPRIGHT
    shutter = Shutter(readout_s=0.08, readout_from=side)
    renderer = SceneRenderer(glowing(wall, motion), CAMERA, settings)
    image = renderer.exposed(path, shutter, 1, seed=3)[..., 0]
    lines = np.arange(len(image) if side == "top" else image.shape[1])
    delays = 0.08 * (lines / lines[-1] - 0.5) * (1 if side == "top" else -1)
    size = CAMERA.width if side == "top" else CAMERA.height
    edge = size - image.sum(axis=1 if side == "top" else 0) / 1e-6
    np.testing.assert_allclose(edge, size / 2 + PX_PER_S * (0.1 + delays), atol=0.1)


POSE = Trajectory(position_m=(0, 0, 0), look_at_m=(3, 1, 0.2)).poses()[0]


def rendered(camera, seed=1, **settings):
    settings = RenderSettings(bands_nm=((500, 600),), max_depth=2, **settings)
    return SceneRenderer(glowing_room(), camera, settings).radiance(POSE, seed)


@pytest.mark.parametrize("most", [1, 7, 1000, 2**20, 2**28])
@pytest.mark.parametrize("samples", [1, 25, 100_000])
@pytest.mark.parametrize(("width", "height"), [(1, 1), (240, 240), (720, 361), (16384, 8192)])
def test_passes_cover_the_frame_with_no_more_samples_than_allowed(width, height, samples, most):
    rows, of_pass, repeats = plan_passes(width, height, samples, most)
    strips = -(-height // rows)
    assert strips * rows >= height > (strips - 1) * rows
    assert of_pass * repeats >= samples > (of_pass - 1) * repeats
    assert width * rows * of_pass <= max(most, width) or rows == of_pass == 1
    assert repeats == 1 or rows == 1


@pytest.mark.parametrize(
    "camera",
    [
        PerspectiveCamera(width=60, height=45, fov_deg=80),
        EquirectangularCamera(width=80, height=37),
        CylindricalCamera(width=80, height=37, fov_deg=200, lower_deg=-30, upper_deg=50),
    ],
    ids=lambda camera: camera.kind,
)
def test_a_frame_in_strips_is_the_frame_in_one(camera):
    whole, other = (rendered(camera, seed, samples_per_pixel=64) for seed in (1, 2))
    strips = rendered(camera, 3, samples_per_pixel=64, samples_per_pass=64 * 800)
    noise = np.median(np.abs(whole - other))
    # The strips differ from the whole by as much as another seed does: of 30 such ratios the
    # standard deviation is 3.5 % at most (medians, since few pixels at the room's edges have most
    # of the variance), so the limits are 5 of them away.
    assert 0.8 < np.median(np.abs(strips - whole)) / noise < 1.25
    # A shift by a single row would not go unseen.
    assert np.median(np.abs(strips[1:] - whole[:-1])) > 10 * noise


def test_an_interrupt_is_answered_after_one_pass(monkeypatch):
    calls = []

    def trace(*arguments, **_):
        calls.append(arguments)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(path_tracing.PathIntegrator, "render", trace)
    camera = PerspectiveCamera(width=8, height=8)
    # a shell that runs tests in the background has them ignore Ctrl-C
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(KeyboardInterrupt):
        rendered(camera, samples_per_pixel=4, samples_per_pass=32)
    signal.signal(signal.SIGINT, before)
    assert len(calls) == 1
