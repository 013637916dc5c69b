"""Frames into a recording: counted, timed by the clocks' fit, shown, readable at any moment."""

import numpy as np
import pytest

from megalopta.camera.capturing import State, status_line
from megalopta.camera.recorder import Clock, Recorder
from megalopta.camera.recording import RecordingSettings, open_recording
from megalopta.sensor import open_counts, preset
from megalopta.sensor.formats.protocol import Identity, Settings, frame_packet

RNG = np.random.default_rng(0)
ADC = RNG.integers(500, 4096, (3000, 16, 16)).astype(np.uint16)
IDENTITY = Identity(16, 16, 12, 3300, "A", "test 1")


@pytest.fixture
def recorder(tmp_path):
    made = Recorder(tmp_path, preset("spadcam"), "dark", IDENTITY, Settings(), 0.0)
    made.plugged(0)
    return made


def take(recorder, numbers, first_us=0):
    for place, number in enumerate(numbers):
        device_us = first_us + 1000 * place
        recorder.take(5 + device_us * 1e-6, frame_packet(number, device_us, ADC[place]))


def test_it_opens_at_any_moment_with_what_was_written(recorder, tmp_path):
    assert len(open_recording(tmp_path)) == 0
    take(recorder, range(1500))
    recorder.write(damaged_packets=3)
    take(recorder, range(1500, 1600), 1_500_000)
    recording = open_recording(tmp_path)
    assert len(recording) == len(open_counts(tmp_path / "counts.zarr")["counts"]) == 1500
    assert (recording.kind, recording.exposure_s) == ("dark", 0.05)
    assert not recording.settings.finished and recording.settings.damaged_packets == 3
    np.testing.assert_array_equal(recording.adc[:], ADC[:1500])
    recorder.finish(3)
    assert len(open_recording(tmp_path)) == 1600 and open_recording(tmp_path).settings.finished


def test_times_are_the_hosts(recorder, tmp_path):
    take(recorder, range(3000))
    recorder.finish(0)
    times_s = open_recording(tmp_path).times_s
    np.testing.assert_allclose(times_s, 5 + np.arange(3000) * 1e-3, atol=1e-9)


def test_counts_follow_from_codes_by_step_supply_and_leak(recorder, tmp_path):
    take(recorder, range(100))
    recorder.finish(0)
    recording = open_recording(tmp_path)
    volts = ADC[:100] * 3.3 / 4095
    reference = 3.3 - 7.2e-3 * preset("spadcam").exposure_s
    counts = np.clip(np.rint((reference - volts) / 10e-3), 0, 319)
    np.testing.assert_array_equal(recording.counts[:], counts)
    np.testing.assert_array_equal(recording.saturated[:], counts == 319)


@pytest.mark.parametrize(
    ("numbers", "gaps", "missing"),
    [
        ([2**32 - 2, 2**32 - 1, 0, 1], 0, 0),
        ([2**32 - 1, 3], 1, 3),
        ([5, 6, 9, 10, 20], 2, 11),
    ],
)
def test_gaps_are_counted_through_the_wrap(recorder, tmp_path, numbers, gaps, missing):
    take(recorder, numbers)
    recorder.finish(0)
    settings = open_recording(tmp_path).settings
    assert (settings.frames, settings.gaps, settings.missing_frames) == (
        len(numbers),
        gaps,
        missing,
    )
    np.testing.assert_array_equal(open_recording(tmp_path).sequence_number, numbers)


def test_each_connection_has_its_clock(recorder, tmp_path):
    take(recorder, range(50))
    recorder.plugged(777)
    for number in range(50):
        recorder.take(60 + number * 1e-3, frame_packet(number, 1000 * number, ADC[number]))
    recorder.finish(0)
    recording = open_recording(tmp_path)
    first, second = recording.settings.connections
    assert (second.first_frame, second.raw_offset) == (50, 777)
    assert recording.settings.gaps == 1
    np.testing.assert_allclose(
        recording.times_s[[0, 49, 50, 99]], [5, 5.049, 60, 60.049], atol=1e-9
    )
    assert first.offset_s == pytest.approx(5) and second.offset_s == pytest.approx(60)


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="give the folder of a recording"):
        open_recording(tmp_path)
    (tmp_path / "recording.yaml").write_text("kind: dark\n")
    with pytest.raises(ValueError, match="started: missing; give a value"):
        open_recording(tmp_path)


def fit(device_s, host_s):
    clock = Clock()
    for pair in zip(device_s, host_s, strict=True):
        clock.arrived(*pair)
    return clock.fit


def test_exact_arrivals_give_the_line():
    device_s = np.arange(100) * 0.1
    found = fit(device_s, 3 + 1.0001 * device_s)
    assert found.offset_s == pytest.approx(3, abs=1e-12)
    assert found.rate == pytest.approx(1.0001, abs=1e-12)
    assert found.error_s == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_bursts_and_stalls_do_not_move_it(seed):
    # Delays: exponential of 1 ms, every fifth frame held for up to 50 ms, and three stalls of 0.3 s.
    # In each tenth of 10 000 frames the least of 800 delays is above 25 µs once in e²⁰ times, so
    # both ends of the line are within 25 µs and its slope within 2·25 µs in 80 s.
    rng = np.random.default_rng(seed)
    device_s = np.arange(10_000) * 0.01
    delay_s = rng.exponential(1e-3, device_s.size)
    delay_s += (rng.random(device_s.size) < 0.2) * rng.uniform(0, 0.05, device_s.size)
    for start in rng.integers(0, 9970, 3):
        delay_s[start : start + 30] += np.linspace(0.3, 0, 30)
    host_s = -7 + (1 - 80e-6) * device_s + delay_s
    found = fit(device_s, host_s)
    assert found.rate == pytest.approx(1 - 80e-6, abs=1e-6)
    errors = found.offset_s + found.rate * device_s - (host_s - delay_s)
    assert np.abs(errors).max() < 50e-6
    assert found.error_s < 50e-6 + 0.05 * 10 / 100  # the last corners may be of a burst
    # Least squares follow the delays: this is what the envelope is for.
    slope, offset = np.polyfit(device_s, host_s, 1)
    assert np.abs(offset + slope * device_s - (host_s - delay_s)).min() > 50e-6


def test_a_bent_clock_takes_no_memory_and_its_error_is_told():
    # Host time grows as t + 1e-7·t²: the hull has every point, 2^14 of them.
    device_s = np.linspace(0, 100, 2**14)
    found = fit(device_s, device_s + 1e-7 * device_s**2)
    # The tangent in the middle lies below by 1e-7·(t − 50)², 1e-7·50²/3 on average.
    assert found.error_s == pytest.approx(1e-7 * 2500 / 3, rel=0.05)


RECORD = RecordingSettings(
    kind="dark",
    started="2026-01-01T00:00:00+00:00",
    serial_number="A",
    firmware="f",
    exposure_s=0.05,
    frame_rate_hz=10,
    step_bias=2048,
    row_window=(0, 16),
    gaps=2,
    missing_frames=7,
    damaged_packets=1,
)


def state(plugged=True):
    counts = np.arange(256, dtype=np.uint16).reshape(16, 16)
    return State(RECORD, 120, 9.98, plugged, counts, counts > 250)


def test_a_line_tells_frames_rate_gaps_damage_and_saturated_pixels():
    line = status_line(state())
    assert line == (
        "120 frames, 10.0 frames/s, 2 gaps (7 frames missing), 1 packets damaged, "
        "5 pixels saturated"
    )
    assert status_line(state(plugged=False)).endswith("unplugged, waiting")
