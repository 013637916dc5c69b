"""Light between frames, and events that carry motion within a frame."""

import numpy as np
import pytest

from megalopta.sensor import DeadTime, changed, expose_events, expose_rate, preset
from megalopta.sensor.quantities import histogram
from megalopta.sensor.sampling.streams import Draw
from megalopta.sensor.shot import NextFrames, Shot

from .plainest import sub_frames

IDEAL = changed(preset("ideal"), exposure_s=1.0)


def wave(shift):
    """A smooth texture of 48 × 64 pixels, drifted by (x, y)."""
    y, x = np.indices((48, 64))
    x, y = x - shift[0], y - shift[1]
    return 2 + np.sin(2 * np.pi * x / 21) * np.cos(2 * np.pi * y / 17)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (2.0, 0.0), (-1.5, 2.5)])
def test_a_drifting_texture_is_where_it_drifts_to(velocity):
    frames = np.stack([wave(np.multiply(velocity, t)) for t in range(3)])
    flow = np.broadcast_to(np.array(velocity), (2, 48, 64, 2))
    moved = sub_frames(frames, flow, 4)
    assert moved.shape == (2, 4, 48, 64)
    for frame in range(2):
        for part in range(4):
            true = wave(np.multiply(velocity, frame + (part + 0.5) / 4))
            # Bilinear interpolation of a sine of 17 px per period is off by (π/17)²/2 = 1.7 %.
            inside = np.abs(moved[frame, part] - true)[4:-4, 4:-4]
            assert inside.max() < (0.029 if any(velocity) else 1e-12)


def test_what_is_hidden_in_the_next_frame_is_looked_up_in_the_one_before():
    frames = np.stack((np.full((6, 8), 1.0), np.full((6, 8), 9.0)))
    hidden = np.zeros((1, 6, 8), bool)
    hidden[0, :, :4] = True
    light = sub_frames(frames, np.zeros((1, 6, 8, 2)), 1, hidden)[0, 0]
    np.testing.assert_array_equal(light[:, :4], 1)
    np.testing.assert_array_equal(light[:, 4:], 5)


def test_light_is_not_known_beyond_the_next_frame():
    light, flow, hidden = np.ones((1, 2, 2, 1)), np.zeros((1, 2, 2, 2)), np.zeros((1, 2, 2), bool)
    after = NextFrames(radiance=light, flow=flow, hidden=hidden)
    long = {"sensor": changed(IDEAL, exposure_s=0.02), "draw": Draw(0, "s", 0, 0.01)}
    with pytest.raises(ValueError, match="exposure_s: 0.02 is longer than a frame, 0.01 s"):
        Shot(radiance=light, bands_nm=[(450.0, 550.0)], following=after, **long)


def test_events_come_when_the_light_does():
    rate = np.zeros((1, 4, 8, 8))
    rate[0, 2] = 400.0  # in the third quarter only
    events = expose_events(rate, IDEAL, seed=0, stream="s")
    assert ((events.time_s >= 0.5) & (events.time_s < 0.75)).all()
    expected = 64 * 100.0
    assert abs(events.time_s.size - expected) < 5 * np.sqrt(expected)
    counts = expose_rate(rate, IDEAL, seed=0, stream="s").counts
    assert counts.shape == (1, 8, 8)
    assert abs(counts.sum() - expected) < 5 * np.sqrt(expected)


def test_a_free_running_array_is_one_long_exposure():
    # Ten frames of one dead time each: reset in between, a pixel counts up to one more per frame.
    sensor = changed(IDEAL, dead_time=DeadTime(kind="nonparalyzable", dead_time_s=1.0))
    rate = np.full((10, 30, 30), 5.0)
    reset, running = (
        histogram(expose_events(rate, sensor, seed=1, stream="s", free_running=runs)).sum(axis=0)
        for runs in (False, True)
    )
    long = expose_rate(rate[:1], changed(sensor, exposure_s=10.0), seed=2, stream="s").counts[0]
    scatter = np.sqrt((running.var() + long.var()) / running.size)
    assert abs(running.mean() - long.mean()) < 5 * scatter
    assert reset.mean() > running.mean() + 1
