"""Frames in passes: nothing lost between strips, nothing changed by repeats, Ctrl-C in between."""

import signal

import numpy as np
import pytest

from megalopta.render import RenderSettings, SceneRenderer, path_tracing
from megalopta.render.film import plan_passes
from megalopta.scenes import CylindricalCamera, EquirectangularCamera, PerspectiveCamera, Trajectory

from .conftest import glowing_room

POSE = Trajectory(position_m=(0, 0, 0), look_at_m=(3, 1, 0.2)).poses()[0]


def rendered(camera, seed=1, **settings):
    settings = RenderSettings(bands_nm=((500, 600),), max_depth=2, **settings)
    return SceneRenderer(glowing_room(), camera, settings).radiance(POSE, seed)


@pytest.mark.parametrize("most", [1, 7, 1000, 2**20, 2**28])
@pytest.mark.parametrize("samples", [1, 25, 100_000])
@pytest.mark.parametrize(("width", "height"), [(1, 1), (240, 240), (720, 361), (16384, 8192)])
def test_passes_cover_the_frame_with_no_more_samples_than_allowed(width, height, samples, most):
    passes = plan_passes(width, height, samples, most)
    strips = -(-height // passes.rows)
    assert strips * passes.rows >= height > (strips - 1) * passes.rows
    assert passes.samples * passes.repeats >= samples > (passes.samples - 1) * passes.repeats
    smallest = passes.rows == passes.samples == 1
    assert width * passes.rows * passes.samples <= max(most, width) or smallest
    if passes.repeats > 1:
        assert passes.rows == 1


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
