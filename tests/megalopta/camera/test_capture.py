"""Captures of the emulated camera over a real pseudo-terminal.

What a camera says of itself and cannot be is refused, its texts are shown, never obeyed; and what
answers, but then sends no frames, is given up.
"""

import os
import pty
import random
import resource
import signal
import subprocess
import sys
import threading
import time
import tty
from itertools import cycle, islice

import numpy as np
import pytest
import serial

from megalopta.camera.capture import capture
from megalopta.camera.emulator import EmulatedCamera, flat
from megalopta.camera.link import open_port
from megalopta.camera.recording import open_recording
from megalopta.cli import main as cli
from megalopta.core.errors import UserError
from megalopta.sensor import changed, expose_rate, preset
from megalopta.sensor.formats.protocol import Identity, Kind, Packet, Settings, command

from ..process_group import wait_for
from .conftest import FILM, RUN, acting, emulating, expected_adc, frames, running, wanted

FAST = Settings(exposure_us=5000, frame_rate_mhz=200_000)


def recorded(find, out, **fields):
    """Record with settings of `wanted`, until they are complete."""
    return capture(find, out, wanted(**fields), threading.Event())


def test_what_arrives_is_what_the_sensor_model_reads(emulated, tmp_path):
    with emulated() as find_camera:
        recording = recorded(find_camera, tmp_path / "a", frames=60)
    assert len(recording) == 60 and recording.settings.finished
    assert (recording.gaps, recording.settings.damaged_packets) == (0, 0)
    np.testing.assert_array_equal(np.diff(recording.sequence_number), 1)
    for place, number in enumerate(recording.sequence_number):
        np.testing.assert_array_equal(recording.adc[place], expected_adc(FAST, int(number)))
    nominal = changed(preset("spadcam"), exposure_s=0.005, counter={"calibrated": False})
    rate = FILM(nominal).rates_hz
    # Frames of 64 ms share a stream, named by the first of them.
    place = int(np.flatnonzero(recording.sequence_number % 12 == 0)[0])
    first = int(recording.sequence_number[place])
    direct = expose_rate(rate, nominal, seed=0, stream=0, first_frame=first)
    np.testing.assert_array_equal(recording.counts[place], direct.counts[0])
    np.testing.assert_allclose(np.diff(recording.times_s), 0.005, rtol=2e-3)


def test_bias_and_rows_reach_the_camera(emulated, tmp_path):
    settings = FAST._replace(step_bias=3000, first_row=4, end_row=6)
    with emulated() as find_camera:
        recording = recorded(
            find_camera, tmp_path / "a", frames=5, step_bias=3000, row_window=(4, 6)
        )
    assert recording.settings.sensor.counter.step_v == pytest.approx(10e-3 * 3000 / 2048)
    adc = recording.adc[0]
    assert (adc[:4] == 0xFFFF).all() and (adc[6:] == 0xFFFF).all()
    assert recording.saturated[0][:4].all() and not recording.counts[0][:4].any()
    number = int(recording.sequence_number[0])
    np.testing.assert_array_equal(adc[4:6], expected_adc(settings, number)[4:6])


@pytest.mark.parametrize("lost", [0, 5])
def test_lost_and_damaged_frames_are_counted_and_none_is_wrong(tmp_path, lost):
    """Every tenth frame is lost, or one of its bits is flipped."""

    def then(camera):
        for place, line in enumerate(frames(camera)):
            if place % 10 != lost:
                yield line
            elif lost:
                yield line[:100] + bytes([line[100] ^ 1]) + line[101:]

    with acting(then) as port:
        recording = recorded(lambda: port, tmp_path / "a", frames=50)
    numbers = list(map(int, recording.sequence_number))
    span = numbers[-1] - numbers[0] + 1
    assert recording.gaps == recording.missing_frames == span - 50 >= 5
    damaged = recording.settings.damaged_packets  # some before the first frame and after the last
    assert damaged == 0 if not lost else 0 <= damaged - recording.missing_frames <= 5
    for place, number in enumerate(numbers):
        np.testing.assert_array_equal(recording.adc[place], expected_adc(FAST, number))


def test_a_capture_goes_on_when_the_camera_is_back(tmp_path):
    stop, first, again = (threading.Event() for _ in range(3))
    link = tmp_path / "cam"
    before = []

    def show(recorder, state):
        if recorder.frames > 20:
            first.set()
        if again.is_set():
            before.append(recorder.frames)
            if recorder.frames > before[0] + 60:
                stop.set()

    def record():
        capture(lambda: str(link), tmp_path / "a", wanted(), stop, show, wait_s=60)

    thread = threading.Thread(target=record)
    thread.start()
    with emulating(link):
        assert first.wait(60)
    with emulating(link):
        again.set()
        assert stop.wait(60)
    thread.join()
    recording = open_recording(tmp_path / "a")
    assert list(np.unique(recording.connection)) == [0, 1] and recording.gaps >= 1
    assert (np.diff(recording.times_s) > 0).all()
    for place in (0, -1):
        number = int(recording.sequence_number[place])
        np.testing.assert_array_equal(recording.adc[place], expected_adc(FAST, number))


def test_what_the_sensor_cannot_do_is_refused_and_changes_nothing():
    camera = EmulatedCamera(changed(preset("spadcam"), counter={"leak_v_s": 10.0}), FILM)
    before = camera.settings
    for kind, payload in (command(Kind.SET_FRAME_RATE, 1000), command(Kind.SET_EXPOSURE, 900_000)):
        reply = camera.answer(Packet(kind, 1, 0, payload), 0)
    assert Settings.of(reply.payload).refused  # by then the leak has emptied the counters
    assert camera.settings.exposure_us == before.exposure_us
    with pytest.raises(UserError, match="leakage has taken"):
        EmulatedCamera(changed(preset("spadcam"), counter={"leak_v_s": 70.0}), flat)


def test_a_port_that_comes_later_is_waited_for(emulated, tmp_path, capsys):
    """As of `megalopta spadcam emulate &`, which takes a while to begin."""
    looked = []

    def find():
        looked.append(str(find_camera()) if len(looked) > 2 else str(tmp_path / "nothing"))
        return looked[-1]

    with emulated() as find_camera:
        recording = capture(find, tmp_path / "a", wanted(frames=1), threading.Event(), wait_s=60)
    assert len(recording) == 1 and len(looked) == 4
    assert capsys.readouterr().err.count("capture: waiting up to 60 s") == 1


@pytest.fixture
def terminal():
    """A pseudo-terminal without a camera: what writes to it, and its path."""
    end, other_end = pty.openpty()
    tty.setraw(other_end)
    yield end, os.ttyname(other_end)
    os.close(end)
    os.close(other_end)


def test_a_port_that_is_missing_or_busy_is_told(terminal, tmp_path):
    with pytest.raises(UserError, match="no such port; plug the camera in"):
        recorded(lambda: str(tmp_path / "x"), tmp_path / "a", frames=1)
    assert not (tmp_path / "a").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="no serial port"):
        open_port(str(tmp_path / "file"))
    busy = pytest.raises(UserError, match="another program has it open.*ModemManager")
    with serial.Serial(terminal[1], exclusive=True), busy:
        open_port(terminal[1])


def test_what_says_nothing_or_something_else_is_told(terminal, tmp_path):
    end, path = terminal
    with pytest.raises(UserError, match="is silent"):
        recorded(lambda: path, tmp_path / "a", frames=1)
    stop = threading.Event()

    def chatter():
        while not stop.wait(0.05):
            os.write(end, b"temperature 21.5\r\n")

    thread = threading.Thread(target=chatter)
    thread.start()
    with pytest.raises(UserError, match="does not speak SPADCAM's protocol"):
        recorded(lambda: path, tmp_path / "a", frames=1)
    stop.set()
    thread.join()
    assert not (tmp_path / "a").exists()


@pytest.mark.slow
def test_killed_at_any_moment_whole_frames_are_kept(tmp_path):
    """15 kills; what was killed before the camera was set has recorded nothing."""
    rng, kept = random.Random(0), 0
    for number in range(15):
        out = tmp_path / f"{number}"
        with acting(frames) as port, running("capture", *on(port, out)) as process:
            wait_for(out.exists)
            time.sleep(rng.choice([0.05, 0.5, 2, 5]) * rng.random())
            process.kill()
            assert process.wait(60) == -signal.SIGKILL
        if (out / "recording.yaml").exists():
            recording = open_recording(out)
            assert not recording.settings.finished
            for place in (0, -1) if len(recording) else ():
                number = int(recording.sequence_number[place])
                np.testing.assert_array_equal(recording.adc[place], expected_adc(FAST, number))
            kept += len(recording) > 0
    assert kept >= 6


def test_without_room_the_frames_before_are_kept(tmp_path, capsys):
    """No file may grow beyond 100 kB, as on a full disk: 186 frames of 536 bytes, and 304 bytes."""
    out = tmp_path / "a b"
    line = [sys.executable, "-c", RUN, "spadcam", "capture"]
    with acting(frames) as port:
        ended = subprocess.run(
            [*line, *map(str, on(port, out))],
            capture_output=True,
            text=True,
            timeout=120,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)),
        )
    told = ended.stderr.splitlines()[-1]
    assert ended.returncode == 2 and "the file exceeds the size limit" in told
    assert told.endswith(f"the 186 earlier frames are kept in {out}")
    recording = open_recording(out)
    assert len(recording) == 186
    assert "186 complete frames, 304 bytes of an incomplete one" in capsys.readouterr().err


def on(port, out):
    return ("--port", port, "--out", out, "--rate", 200, "--exposure", 0.005, "--kind", "flat")


ESCAPES = "\x1b[31mA\x07\x00\r\nB"


def saying(kind, **fields):
    """Change what a camera says in its replies of a kind."""

    def answered(packet):
        if packet.kind != kind:
            return packet
        said = (Identity if kind == Kind.IDENTITY else Settings).of(packet.payload)
        return packet._replace(payload=said._replace(**fields).payload())

    return answered


@pytest.mark.parametrize(
    ("kind", "field", "value", "told"),
    [
        (Kind.SETTINGS, "exposure_us", 2**32 - 1, "camera reports .*exposure_us=4294967295.*flash"),
        (Kind.IDENTITY, "rows", 255, "camera reports 255 × 16 pixels.*flash"),
        (Kind.IDENTITY, "adc_bits", 40, "counter.adc_bits: "),
        (Kind.IDENTITY, "supply_mv", 0, "counter.supply_v: "),
    ],
)
def test_what_no_camera_can_be_is_refused(tmp_path, kind, field, value, told):
    refused = pytest.raises(UserError, match=told)
    with acting(frames, saying(kind, **{field: value})) as port, refused:
        recorded(lambda: port, tmp_path / "a", frames=5)
    assert not (tmp_path / "a").exists()


def test_control_codes_of_a_serial_number_go_nowhere(tmp_path, monkeypatch, capsys):
    out = tmp_path / "a"
    monkeypatch.setattr("signal.signal", lambda *_: None)  # the command puts in its own handlers
    answered = saying(Kind.IDENTITY, serial_number=ESCAPES, firmware="\x1b]0;x\x07")
    with acting(frames, answered) as port:
        words = f"--port {port} --out {out} --frames 5 --rate 200 --exposure 0.005"
        cli.main(["spadcam", "capture", *words.split()])
    printed, told = capsys.readouterr()
    assert r"frames of \x1b[31mA\x07\x00\r\nB," in printed
    written = (out / "recording.yaml").read_text()
    for text in (printed, told, written):
        assert not any(ord(each) < 32 and each != "\n" for each in text)
        assert r"[31mA" in text or text is told
    assert open_recording(out).settings.serial_number == r"\x1b[31mA\x07\x00\r\nB"


GARBAGE = np.random.default_rng(0).integers(0, 256, 4096, np.uint8).tobytes()


@pytest.mark.parametrize("sent", [0, 20])
@pytest.mark.parametrize("garbage", [(), (GARBAGE,)])
def test_a_capture_that_frames_leave_ends_and_keeps_them(monkeypatch, tmp_path, garbage, sent):
    monkeypatch.setattr("megalopta.camera.capture.PATIENCE_S", 0.5)
    out = tmp_path / "a"

    def some(camera):
        yield from islice(frames(camera), sent)
        yield from cycle(garbage)

    refused = pytest.raises(UserError, match=r"no new frame in 0\.5 s; unplug")
    with acting(some) as port, refused as error:
        recorded(lambda: port, out, frames=100)
    assert out.exists() == bool(sent)
    if sent:
        recording = open_recording(out)
        assert str(error.value).endswith(f"; the {len(recording)} earlier frames are kept in {out}")
        # The first one was exposed before the settings held.
        assert len(recording) >= 19 and recording.settings.finished


def test_1000_frames_a_second(emulated, tmp_path):
    settings = {"frames": 500, "exposure_s": 1e-3, "frame_rate_hz": 1000}
    with emulated() as find:
        recording = recorded(find, tmp_path / "a", **settings)
    first, last = (int(recording.sequence_number[at]) for at in (0, -1))
    # Frames that the camera drops while this machine stands still are counted.
    assert recording.missing_frames == last - first + 1 - len(recording)
    assert (len(recording), recording.settings.damaged_packets) == (500, 0)
