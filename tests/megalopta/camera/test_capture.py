"""Captures of the emulated camera over a real pseudo-terminal."""

import os
import pty
import threading
import time
import tty

import numpy as np
import pytest
import serial

from megalopta.camera.capturing import capture
from megalopta.camera.emulated import EmulatedCamera, Faults, Flat
from megalopta.camera.link import Arrived, Link, Plugged, open_port
from megalopta.camera.recording import open_recording
from megalopta.core.errors import UserError
from megalopta.sensor import changed, expose_rate, preset
from megalopta.sensor.formats.protocol import Kind, Packet, Parser, Settings, command, samples_of

from .conftest import expected_adc, wanted

FAST = Settings(exposure_us=5000, frame_rate_mhz=200_000)


def recorded(camera, out, settings, stop=None):
    capture(camera.find, out, settings, stop or threading.Event())
    return open_recording(out)


def frames_in(data):
    return [packet for packet in Parser().feed(data) if packet.kind == Kind.FRAME]


def test_what_arrives_is_what_the_sensor_model_reads(emulated, tmp_path):
    with emulated() as camera:
        recording = recorded(camera, tmp_path / "a", wanted(frames=60))
    assert len(recording) == 60 and recording.settings.finished
    assert (recording.settings.gaps, recording.settings.damaged_packets) == (0, 0)
    np.testing.assert_array_equal(np.diff(recording.sequence_number), 1)
    for place, number in enumerate(recording.sequence_number):
        np.testing.assert_array_equal(recording.adc[place], expected_adc(FAST, int(number)))
    nominal = changed(preset("spadcam"), exposure_s=0.005, counter={"calibrated": False})
    rate = Flat((5e6,)).rates_hz(np.zeros(1), nominal)
    # Frames of 64 ms share a stream, named by the first of them.
    place = int(np.flatnonzero(recording.sequence_number % 12 == 0)[0])
    first = int(recording.sequence_number[place])
    direct = expose_rate(rate, nominal, seed=0, stream=0, first_frame=first)
    np.testing.assert_array_equal(recording.counts[place], direct.counts[0])
    np.testing.assert_allclose(np.diff(recording.times_s), 0.005, rtol=2e-3)


def test_bias_and_rows_reach_the_camera(emulated, tmp_path):
    settings = FAST._replace(step_bias=3000, first_row=4, end_row=6)
    with emulated() as camera:
        recording = recorded(
            camera, tmp_path / "a", wanted(frames=5, step_bias=3000, row_window=(4, 6))
        )
    assert recording.sensor.counter.step_v == pytest.approx(10e-3 * 3000 / 2048)
    adc = recording.adc[0]
    assert (adc[:4] == 0xFFFF).all() and (adc[6:] == 0xFFFF).all()
    assert recording.saturated[0][:4].all() and not recording.counts[0][:4].any()
    number = int(recording.sequence_number[0])
    np.testing.assert_array_equal(adc[4:6], expected_adc(settings, number)[4:6])


def test_damage_on_the_line_costs_frames_but_none_is_wrong(emulated, tmp_path):
    with emulated(Faults(noise=3e-4, lost=1e-4)) as camera:
        recording = recorded(camera, tmp_path / "a", wanted(frames=100))
    settings = recording.settings
    assert settings.damaged_packets > 5 and settings.gaps > 5
    span = int(recording.sequence_number[-1]) - int(recording.sequence_number[0]) + 1
    assert settings.missing_frames == span - 100
    for place, number in enumerate(recording.sequence_number):
        np.testing.assert_array_equal(recording.adc[place], expected_adc(FAST, int(number)))
    logged = {
        packet.sequence: packet for packet in frames_in((tmp_path / "a" / "raw.bin").read_bytes())
    }
    for place, number in enumerate(recording.sequence_number):
        np.testing.assert_array_equal(recording.adc[place], samples_of(logged[int(number)]))


def test_bursts_do_not_shift_times(emulated, tmp_path):
    with emulated(Faults(burst_s=0.2, drift_ppm=300)) as camera:
        recording = recorded(camera, tmp_path / "a", wanted(frames=400))
    (connection,) = recording.settings.connections
    # Frames that are sent at once come within 20 ms of their time, in 2 s: 1 %, but for a clock at
    # most LARGEST_DRIFT.
    assert abs(connection.rate - 1) <= 1e-3 + 1e-9
    frames = np.diff(recording.sequence_number.astype(int))  # a busy machine may lose some
    np.testing.assert_allclose(np.diff(recording.times_s) / frames, 0.005, rtol=1.1e-3)


@pytest.mark.slow
def test_unplugging_ten_times_loses_no_logged_byte(emulated, tmp_path):
    faults = Faults(unplug_every_s=0.4, unplug_s=0.1)
    events = []
    with emulated(faults) as camera, Link(camera.find, tmp_path / "raw.bin") as link:
        end = time.monotonic() + 60
        while sum(isinstance(event, Plugged) for event in events) < 11:
            assert time.monotonic() < end
            if event := link.next(0.5):
                events.append(event)
        link.close()
        while event := link.next(0):
            events.append(event)
        sent = list(map(bytes, camera.sent))
    raw = (tmp_path / "raw.bin").read_bytes()
    offsets = [event.raw_offset for event in events if isinstance(event, Plugged)]
    pieces = [raw[a:b] for a, b in zip(offsets, [*offsets[1:], len(raw)], strict=True)]
    assert offsets[0] == 0 and sum(map(len, pieces)) == len(raw) > 5 * 536
    # Every connection's bytes are one unbroken piece of what the camera sent then.
    assert all(any(piece in each for each in sent) for piece in pieces)
    decoded = [packet for piece in pieces for packet in Parser().feed(piece)]
    assert [event.packet for event in events if isinstance(event, Arrived)] == decoded


def test_a_capture_goes_on_when_the_camera_is_back(emulated, tmp_path):
    with emulated(Faults(unplug_every_s=2, unplug_s=0.2)) as camera:
        recording = recorded(camera, tmp_path / "a", wanted(seconds=3.5))
    settings, adc = recording.settings, recording.adc[:]
    connections = settings.connections
    assert len(connections) > 1 and settings.gaps >= len(connections) - 1
    assert (np.diff(recording.times_s) > 0).all()
    raw = (tmp_path / "a" / "raw.bin").read_bytes()
    firsts = [each.first_frame for each in connections] + [len(recording)]
    offsets = [each.raw_offset for each in connections] + [len(raw)]
    for place in range(len(connections)):
        frames = slice(*firsts[place : place + 2])
        taken = list(map(int, recording.sequence_number[frames]))
        if not taken:  # unplugged before it was set, or stopped
            continue
        # All that was logged is there, from the first frame with these settings on.
        logged = {
            packet.sequence: samples_of(packet)
            for packet in frames_in(raw[slice(*offsets[place : place + 2])])
            if taken[0] <= packet.sequence <= taken[-1]
        }
        is_last = place == len(connections) - 1
        assert taken == sorted(logged)
        assert is_last or taken[-1] == frames_in(raw[: offsets[place + 1]])[-1].sequence
        np.testing.assert_array_equal(adc[frames], [logged[number] for number in taken])


def test_1000_frames_a_second(emulated, tmp_path):
    settings = wanted(frames=500, exposure_s=1e-3, frame_rate_hz=1000)
    with emulated() as camera:
        recording = recorded(camera, tmp_path / "a", settings)
        sent = frames_in(bytes(camera.sent[0]))
    # What the camera drops, because this machine stands still for longer than its buffer lasts,
    # is not the link's fault; all that left it is there.
    first, last = (int(recording.sequence_number[at]) for at in (0, -1))
    numbers = [packet.sequence for packet in sent]
    expected = numbers[numbers.index(first) : numbers.index(last) + 1]
    np.testing.assert_array_equal(recording.sequence_number, expected)
    missing = last - first + 1 - len(expected)
    assert recording.settings.missing_frames == missing
    assert recording.settings.damaged_packets == 0


def test_what_the_sensor_cannot_do_is_refused_and_changes_nothing():
    camera = EmulatedCamera(changed(preset("spadcam"), counter={"leak_v_s": 10.0}), Flat((5e6,)))
    before = camera.settings
    for kind, payload in (command(Kind.SET_FRAME_RATE, 1000), command(Kind.SET_EXPOSURE, 900_000)):
        reply = camera.answer(Packet(kind, 1, 0, payload), 0)
    assert Settings.of(reply.payload).refused  # by then the leak has emptied the counters
    assert camera.settings.exposure_us == before.exposure_us
    with pytest.raises(UserError, match="leakage has taken"):
        EmulatedCamera(changed(preset("spadcam"), counter={"leak_v_s": 70.0}), Flat())


def test_a_port_that_is_missing_is_told(tmp_path):
    with pytest.raises(UserError, match="no such port; plug the camera in"):
        open_port(str(tmp_path / "nothing"))
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="no serial port"):
        open_port(str(tmp_path / "file"))
    with pytest.raises(UserError, match="no such port"):
        capture(lambda: str(tmp_path / "x"), tmp_path / "a", wanted(frames=1), threading.Event())
    assert not (tmp_path / "a").exists()


def test_a_port_that_comes_later_is_waited_for(emulated, tmp_path, capsys):
    """As of `megalopta spadcam emulate &`, which takes a while to begin."""
    looked = []

    def find():
        looked.append(str(camera.find()) if len(looked) > 2 else str(tmp_path / "nothing"))
        return looked[-1]

    with emulated() as camera:
        record = capture(find, tmp_path / "a", wanted(frames=1), threading.Event(), wait_s=60)
    assert record.frames == 1 and len(looked) == 4
    assert capsys.readouterr().err.count("capture: waiting up to 60 s") == 1


@pytest.fixture
def terminal():
    """A pseudo-terminal without a camera: what writes to it, and its path."""
    end, other_end = pty.openpty()
    tty.setraw(other_end)
    yield end, os.ttyname(other_end)
    os.close(end)
    os.close(other_end)


def test_a_busy_port_is_told(terminal):
    with (
        serial.Serial(terminal[1], exclusive=True),
        pytest.raises(UserError, match="another program has it open.*ModemManager"),
    ):
        open_port(terminal[1])


def test_a_port_that_is_not_permitted_is_told(monkeypatch):
    def refuse(*_, **__):
        raise serial.SerialException(13, "Permission denied")

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(UserError, match="dialout.*udev"):
        open_port("/dev/ttyACM0")


def test_what_says_nothing_or_something_else_is_told(terminal, tmp_path):
    end, path = terminal
    with pytest.raises(UserError, match="is silent"):
        capture(lambda: path, tmp_path / "a", wanted(frames=1), threading.Event())
    stop = threading.Event()

    def chatter():
        while not stop.wait(0.05):
            os.write(end, b"temperature 21.5\r\n")

    thread = threading.Thread(target=chatter)
    thread.start()
    try:
        with pytest.raises(UserError, match="does not speak SPADCAM's protocol"):
            capture(lambda: path, tmp_path / "a", wanted(frames=1), threading.Event())
    finally:
        stop.set()
        thread.join()
    assert not (tmp_path / "a").exists()


def test_stopped_before_it_began(emulated, tmp_path):
    stop = threading.Event()
    stop.set()
    with emulated() as camera, pytest.raises(UserError, match="before the camera answered"):
        capture(camera.find, tmp_path / "a", wanted(frames=1), stop)
    assert not (tmp_path / "a").exists()


def test_a_command_to_a_port_that_is_being_closed_is_sent_again(emulated, tmp_path, monkeypatch):
    write, closing = serial.Serial.write, [TypeError("'NoneType' object")]

    def failing_once(port, data):
        if closing:
            raise closing.pop()
        return write(port, data)

    monkeypatch.setattr(serial.Serial, "write", failing_once)
    with emulated() as camera, Link(camera.find, tmp_path / "raw.bin") as link:
        assert link.identity().serial_number == "EMULATED"
