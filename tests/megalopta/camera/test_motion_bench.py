"""The motion bench against a row of pixels in plain NumPy, written apart from it."""

import numpy as np
import pytest

from megalopta.camera.motion_bench import (
    FRAMES,
    OPEN_PHOTONS,
    PIXELS,
    SENSORS,
    passing_rates,
    peaks,
    pixels_per_frame,
    stimulus,
)
from megalopta.sensor import event_moments
from megalopta.sensor.spad.device import draw_fixed_pattern

POISSON, SPADCAM = SENSORS.values()
HIDDEN_PHOTONS = 27.0
STEPS = {"NDM": 1 / 1.6, "NDS": 1 / 1.4}  # 60 and 40 ms at 10 frames/s


def light(velocity, phase):
    """Mean counts (2·FRAMES, 16): the edge comes from the right, blurred by its way, and returns.

    It is in the middle of the row after half of FRAMES + 1 frames from the first opening.
    """
    time = np.arange(FRAMES)[:, None] + phase + (np.arange(200) + 0.5) / 200
    edge = PIXELS / 2 - velocity * (time - (FRAMES + 1) / 2)
    hidden = np.clip(np.arange(1, PIXELS + 1)[:, None, None] - edge, 0, 1).mean(-1).T
    forth = OPEN_PHOTONS - (OPEN_PHOTONS - HIDDEN_PHOTONS) * hidden
    return np.concatenate([forth, forth[::-1]])


def peak_responses(method, counts):
    """Peaks (2, ..., 10) of both crossings from counts (2·FRAMES, ..., 16)."""
    kernel = np.array([1, 2, 3, 2, 1]) / 9
    rows = np.apply_along_axis(np.convolve, -1, counts, kernel, "valid")
    a, low, slow, found = STEPS[method], rows[0], np.zeros_like(rows[0]), []
    for row in rows:
        low = (1 - a) * low + a * row
        high = row - low
        slow = (1 - a) * slow + a * high
        left, right, own = slow[..., :-2], slow[..., 2:], high[..., 1:-1]
        found.append(np.abs(own * (left + right) if method == "NDM" else own + left + right))
    found = np.array(found)
    return np.array([found[6:FRAMES].max(0), found[FRAMES + 6 :].max(0)])


@pytest.mark.parametrize("speed_mm_s", [1.0, 10.0])
def test_the_rendered_row_is_that_of_an_edge_blurred_by_its_way_in_a_frame(speed_mm_s):
    seen = stimulus(speed_mm_s)[:, :, 0, :, 0]
    velocity = pixels_per_frame(speed_mm_s)
    # 16 strata across a pixel and a midpoint rule over the instants: 1.2 counts of 38 at most
    for phase, rows in enumerate(OPEN_PHOTONS * seen / seen.max()):
        np.testing.assert_allclose(rows, light(velocity, phase / 4), atol=1.2)


def test_open_and_hidden_pixels_detect_the_printed_photons_on_top_of_dark_counts():
    for sensor in (POISSON, SPADCAM):
        expected, _ = event_moments(passing_rates(10.0, sensor)[:FRAMES], sensor)
        dark = sensor.exposure_s * draw_fixed_pattern(sensor, (16, PIXELS)).dark_counts_hz
        # a dead time of 1 µs takes 0.3 % of 320 counts, 0.07 % of what the array counts
        assert (expected[0] - dark).mean() == pytest.approx(OPEN_PHOTONS, rel=0.005)
        assert (expected[FRAMES - 1] - dark).mean() == pytest.approx(HIDDEN_PHOTONS, rel=0.01)


@pytest.mark.parametrize("method", ["NDM", "NDS"])
def test_peaks_without_noise_are_those_of_the_plain_recursion(method):
    rows = np.stack([light(pixels_per_frame(9.0), k / 4) for k in range(4)], axis=1)
    expected = peak_responses(method, rows).mean()
    # the rendered edge is good to 3 % of its step in single pixels, and pooling averages that
    assert peaks(9.0, POISSON)[method].ideal.mean() == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("method", ["NDM", "NDS"])
def test_signal_to_noise_with_poisson_noise_is_that_of_the_plain_recursion(method):
    rows = np.stack([light(pixels_per_frame(5.0), k / 4) for k in range(4)], axis=1)
    counts = np.random.default_rng(0).poisson(rows[:, None], (2 * FRAMES, 300, 4, PIXELS))
    found = peak_responses(method, counts).reshape(-1, 10)
    expected = 20 * np.log10(found.mean() / np.sqrt(found.var(axis=0).mean()))
    # some 1200 independent peaks here and 5000 there: σ to 2.2 %, 0.2 dB; 6 σ
    assert peaks(5.0, POISSON)[method].snr_db == pytest.approx(expected, abs=1.2)
