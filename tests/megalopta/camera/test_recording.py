"""Frames into a recording: counted, timed, shown, readable at any moment."""

import os

import numpy as np
import pytest

from megalopta.camera.recording import Recorder, open_recording
from megalopta.core.errors import UserError
from megalopta.sensor import preset
from megalopta.sensor.formats.protocol import Identity, Settings, frame_packet

from ..harm import BOMB, replaced

RNG = np.random.default_rng(0)
ADC = RNG.integers(500, 4096, (3000, 16, 16)).astype(np.uint16)
IDENTITY = Identity(16, 16, 12, 3300, "A", "test 1")


@pytest.fixture
def recorder(tmp_path):
    made = Recorder(tmp_path, preset("spadcam"), "dark", IDENTITY, Settings(), 0.0)
    yield made
    made.finish(0)


def take(recorder, numbers, first_us=0):
    for place, number in enumerate(numbers):
        device_us = first_us + 1000 * place
        recorder.take(5 + device_us * 1e-6, frame_packet(number, device_us, ADC[place]))


def test_it_opens_at_any_moment_without_an_incomplete_record(recorder, tmp_path, capsys):
    assert len(open_recording(tmp_path)) == 0
    take(recorder, range(1500))
    with (tmp_path / "frames.bin").open("ab") as file:
        file.write(bytes(100))
    recording = open_recording(tmp_path)
    assert "not finished; 1500 complete frames, 100 bytes of an" in capsys.readouterr().err
    assert len(recording) == 1500
    assert (recording.kind, recording.exposure_s) == ("dark", 0.05)
    np.testing.assert_array_equal(recording.adc[:], ADC[:1500])


def test_counts_follow_from_codes_by_step_supply_and_leak(recorder, tmp_path):
    take(recorder, range(100))
    recorder.finish(3)
    recording = open_recording(tmp_path)
    assert recording.settings.finished and recording.settings.damaged_packets == 3
    volts = ADC[:100] * 3.3 / 4095
    reference = 3.3 - 7.2e-3 * preset("spadcam").exposure_s
    counts = np.clip(np.rint((reference - volts) / 10e-3), 0, 319)
    np.testing.assert_array_equal(recording.counts[:], counts)
    np.testing.assert_array_equal(recording.saturated[:], counts == 319)


@pytest.mark.parametrize(
    ("numbers", "gaps", "missing"),
    [([2**32 - 2, 2**32 - 1, 0, 1], 0, 0), ([2**32 - 1, 3], 1, 3), ([5, 6, 9, 10, 20], 2, 11)],
)
def test_gaps_are_counted_through_the_wrap(recorder, tmp_path, numbers, gaps, missing):
    take(recorder, numbers)
    recorder.finish(0)
    recording = open_recording(tmp_path)
    assert (recording.gaps, recording.missing_frames) == (gaps, missing)
    assert recorder.missing_frames == missing
    np.testing.assert_array_equal(recording.sequence_number, numbers)


def test_each_connection_has_its_clock_and_begins_with_the_fastest_frame(recorder, tmp_path):
    take(recorder, range(50))
    recorder.plugged_again()
    for number in range(50):
        late_s = 0.3 * (number % 7 > 0)
        recorder.take(60 + number * 1e-3 + late_s, frame_packet(number, 1000 * number, ADC[number]))
    recorder.finish(0)
    recording = open_recording(tmp_path)
    np.testing.assert_array_equal(recording.connection, np.repeat([0, 1], 50))
    assert recording.gaps == 1
    np.testing.assert_allclose(
        recording.times_s[[0, 49, 50, 99]], [5, 5.049, 60, 60.049], atol=1e-9
    )


@pytest.mark.parametrize("name", ["recording.yaml", "frames.bin"])
@pytest.mark.parametrize("put", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
def test_a_pipe_or_link_in_a_recording_is_refused(recorder, tmp_path, name, put):
    replaced(tmp_path / name, put)
    with pytest.raises((UserError, ValueError), match=f"{name}: "):
        open_recording(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("format: 2", "format: 99", "newer than 2"),
        ("exposure_s: 0.05\nframe", "exposure_s: -1\nframe", "exposure_s: "),
        ("format: 2", f"{BOMB}format: *j", "recording.yaml: "),
        ("started: ", "begun: ", "started: missing; give a value"),
    ],
)
def test_a_header_that_cannot_be_is_refused(recorder, tmp_path, old, new, told):
    path = tmp_path / "recording.yaml"
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises((UserError, ValueError), match=told):
        open_recording(tmp_path)
