"""The motion bench against a row of pixels in plain NumPy, written apart from it."""

import numpy as np
import pytest

from megalopta.camera.motion_bench import (
    FRAMES,
    OPEN_PHOTONS,
    PIXELS,
    SENSORS,
    cut_passages,
    cut_rest,
    detector,
    passing_rates,
    peaks,
    pixels_per_frame,
    stimulus,
)
from megalopta.sensor import event_moments
from megalopta.sensor.spad.fixed_pattern import draw_fixed_pattern

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


@pytest.mark.parametrize("speed_mm_s", [1.0, 6.0, 10.0])
def test_the_rendered_row_is_that_of_an_edge_blurred_by_its_way_in_a_frame(speed_mm_s):
    seen = stimulus(speed_mm_s)[:, :, 0, :, 0]
    velocity = pixels_per_frame(speed_mm_s)
    # 16 strata across a pixel and a midpoint rule over the instants: 1.2 counts of 38 at most
    for phase, rows in enumerate(OPEN_PHOTONS * seen / seen.max()):
        np.testing.assert_allclose(rows, light(velocity, phase / 4), atol=1.2)


def test_10_mm_per_second_are_the_dissertations_16_7_pixels_per_frame():
    assert pixels_per_frame(10) == pytest.approx(16.7, abs=0.05)


def test_open_and_hidden_pixels_detect_the_printed_photons_on_top_of_dark_counts():
    for sensor in (POISSON, SPADCAM):
        expected, _ = event_moments(passing_rates(10.0, sensor)[:FRAMES], sensor)
        dark = sensor.exposure_s * draw_fixed_pattern(sensor, (16, PIXELS)).dark_counts_hz
        # a dead time of 1 µs takes 0.3 % of 320 counts, 0.07 % of what the array counts
        assert (expected[0] - dark).mean() == pytest.approx(OPEN_PHOTONS, rel=0.005)
        assert (expected[FRAMES - 1] - dark).mean() == pytest.approx(HIDDEN_PHOTONS, rel=0.01)


@pytest.mark.parametrize("method", ["NDM", "NDS"])
@pytest.mark.parametrize("speed_mm_s", [2.0, 9.0])
def test_peaks_without_noise_are_those_of_the_plain_recursion(method, speed_mm_s):
    rows = np.stack([light(pixels_per_frame(speed_mm_s), k / 4) for k in range(4)], axis=1)
    expected = peak_responses(method, rows).mean()
    # the rendered edge is good to 3 % of its step in single pixels, and pooling averages that
    assert peaks(speed_mm_s, POISSON)[method].ideal.mean() == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("method", ["NDM", "NDS"])
def test_signal_to_noise_with_poisson_noise_is_that_of_the_plain_recursion(method):
    rows = np.stack([light(pixels_per_frame(5.0), k / 4) for k in range(4)], axis=1)
    counts = np.random.default_rng(0).poisson(rows[:, None], (2 * FRAMES, 300, 4, PIXELS))
    found = peak_responses(method, counts).reshape(-1, 10)
    expected = 20 * np.log10(found.mean() / np.sqrt(found.var(axis=0).mean()))
    # some 1200 independent peaks here and 5000 there: σ to 2.2 %, 0.2 dB; 6 σ
    assert peaks(5.0, POISSON)[method].snr_db == pytest.approx(expected, abs=1.2)


@pytest.mark.parametrize("method", ["NDM", "NDS"])
def test_an_edge_that_stands_still_answers_with_its_noise_alone(method):
    still = peaks(0.0, SPADCAM)[method]
    assert still.ideal.max() < 1e-3 * still.mean


@pytest.mark.parametrize("speed_mm_s", [1.0, 10.0])
def test_nds_has_more_signal_to_noise_than_ndm_and_spadcam_less_than_poisson_noise(speed_mm_s):
    poisson, spadcam = (peaks(speed_mm_s, sensor) for sensor in (POISSON, SPADCAM))
    # each ratio is good to 0.2 dB; the differences are above 1.5 dB, 5 σ and more
    for measured in (poisson, spadcam):
        assert measured["NDS"].snr_db > measured["NDM"].snr_db
    for method in ("NDM", "NDS"):
        assert poisson[method].snr_db > spadcam[method].snr_db


@pytest.mark.parametrize("method", ["NDM", "NDS"])
def test_detectors_have_the_printed_time_constants(method):
    assert detector(method).filter_step == pytest.approx(STEPS[method])


RNG = np.random.default_rng(0)
OPEN, HIDDEN, DARK = 65.0, 27.0, 60.0


def level(frames, middles, velocity):
    """Share of 16 pixels that is free, frame by frame: edges in the middle at these times."""
    time = (np.arange(frames * 50) + 0.5) / 50
    hidden = np.zeros_like(time)
    for number, middle in enumerate(middles):
        passed = np.clip(0.5 + velocity * (time - middle) / 16, 0, 1)
        hidden += passed if number % 2 == 0 else -passed
    return 1 - hidden.reshape(frames, 50).mean(axis=1)


def recorded(frames, middles, velocity):
    mean = HIDDEN + (OPEN - HIDDEN) * level(frames, middles, velocity) + DARK
    return RNG.poisson(np.broadcast_to(mean[:, None, None], (frames, 16, 16)))


@pytest.mark.parametrize("velocity", [1.67, 5.0, 16.7])
@pytest.mark.parametrize("at", [20.0, 33.3, 50.75])
def test_edges_are_in_the_middle_of_what_is_cut(velocity, at):
    middles = [at, at + 40.5, at + 85, at + 121.2]
    counts = recorded(220, middles, velocity)
    cut = cut_passages(counts).reshape(4, FRAMES, 16, 16)
    for middle, frames in zip(middles, cut, strict=True):
        # The array's mean has σ 0.6 counts, 0.15 frames of the slowest edge; 6 σ beyond a half.
        starts = [n for n in range(189) if (counts[n : n + FRAMES] == frames).all()]
        assert starts[0] == pytest.approx(middle - FRAMES / 2, abs=1.4)


def test_a_passage_begins_where_the_plate_hides():
    cut = cut_passages(recorded(250, [20, 60, 100, 140, 180, 220], 5.0)[45:])
    means = cut.reshape(2, 2, FRAMES, 16, 16).mean(axis=(0, 3, 4))
    np.testing.assert_allclose(means[0, [0, -1]], [OPEN + DARK, HIDDEN + DARK], rtol=0.03)
    np.testing.assert_allclose(means[1, [0, -1]], [HIDDEN + DARK, OPEN + DARK], rtol=0.03)


def test_what_shows_no_passages_is_refused():
    # Of a normal distribution 0.9 of the frames are within 3.3 σ, and 6 σ are asked for.
    still = recorded(300, [], 5.0)
    with pytest.raises(ValueError, match=r"no edge passes, the array counts 12\d"):
        cut_passages(still)
    with pytest.raises(ValueError, match="1 passages of the plate to and fro in 130 frames"):
        cut_passages(recorded(130, [30, 70], 5.0))
    with pytest.raises(ValueError, match="an edge passes 20 frames after another"):
        cut_passages(recorded(200, [30, 70, 90, 130], 5.0))


def test_a_plate_at_rest_is_cut_into_equal_parts():
    assert len(cut_rest(recorded(300, [], 5.0))) == 4 * 2 * FRAMES
    with pytest.raises(ValueError, match="127 frames; record 128"):
        cut_rest(recorded(127, [], 5.0))
    with pytest.raises(ValueError, match="an edge passes"):
        cut_rest(recorded(200, [30, 70], 5.0))
