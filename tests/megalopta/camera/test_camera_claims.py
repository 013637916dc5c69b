"""What a camera says of itself and cannot be is refused, its texts are shown, never obeyed; and
what answers, but then sends no frames, is given up."""

import threading
from itertools import islice, repeat

import numpy as np
import pytest

from megalopta.camera.capturing import capture
from megalopta.camera.link import find_port, port_lines
from megalopta.camera.recording import open_recording
from megalopta.cli import main as cli
from megalopta.core.errors import UserError
from megalopta.sensor.formats.protocol import Identity, Kind, Settings, encode

from .conftest import acting, frames, wanted

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
    ("kind", "field", "value"),
    [
        (Kind.SETTINGS, "exposure_us", 2**32 - 1),
        (Kind.SETTINGS, "frame_rate_mhz", 0),
        (Kind.SETTINGS, "step_bias", 65535),
        (Kind.SETTINGS, "first_row", 17),
        (Kind.SETTINGS, "end_row", 200),
        (Kind.IDENTITY, "rows", 255),
        (Kind.IDENTITY, "columns", 8),
        (Kind.IDENTITY, "adc_bits", 0),
        (Kind.IDENTITY, "adc_bits", 40),
        (Kind.IDENTITY, "supply_mv", 65535),
        (Kind.IDENTITY, "supply_mv", 0),
    ],
)
def test_what_no_camera_can_be_is_refused(tmp_path, kind, field, value):
    refused = pytest.raises(UserError, match=f"the camera reports {field} {value}.*; flash")
    with acting(frames, saying(kind, **{field: value})) as port, refused:
        capture(lambda: port, tmp_path / "a", wanted(frames=5), threading.Event())
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


def test_control_codes_of_a_usb_device_are_escaped(monkeypatch):
    from serial.tools import list_ports
    from serial.tools.list_ports_common import ListPortInfo

    def port(path):
        info = ListPortInfo(path)
        info.vid, info.serial_number, info.description = 0x16C0, "\x1b[31m", "a\x1b]0;b\x07"
        return info

    monkeypatch.setattr(list_ports, "comports", lambda: [port("/dev/none1"), port("/dev/none2")])
    assert all(line.isprintable() for line in port_lines())
    with pytest.raises(UserError, match="several cameras") as refused:
        find_port()
    assert str(refused.value).isprintable()


@pytest.mark.parametrize("kind", ["", "a/../../b", "\x1b[31m", "a\nb", "\udcff", "x" * 101])
def test_a_kind_is_a_short_name(kind, tmp_path):
    with pytest.raises(UserError, match="--kind: .*; give 1 to 100 letters"):
        capture(lambda: "/none", tmp_path / "a", wanted(kind=kind), threading.Event())


def test_control_codes_of_a_recording_are_escaped(tmp_path):
    with acting(frames) as port:
        capture(lambda: port, tmp_path / "a", wanted(frames=5), threading.Event())
    path = tmp_path / "a" / "recording.yaml"
    path.write_text(path.read_text().replace("kind: flat", 'kind: "\\e[2J\\x07"'))
    assert open_recording(tmp_path / "a").kind == r"\x1b[2J\x07"


RNG = np.random.default_rng(0)
GARBAGE = RNG.integers(0, 256, 4096, np.uint8).tobytes()
PATIENCE_S = 0.5


def nothing(camera):
    yield from ()


def zeros(camera):
    yield from repeat(bytes(4096))


def garbage(camera):
    yield from repeat(GARBAGE)


def half_packets(camera):
    while True:
        yield encode(camera.next_frame())[:300]


def the_same_frame(camera):
    line = [*islice(frames(camera), 20)][-1]
    yield from repeat(line)


def frames_then(what):
    def then(camera):
        yield from islice(frames(camera), 20)
        yield from what(camera)

    return then


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr("megalopta.camera.capturing.PATIENCE_S", PATIENCE_S)


@pytest.mark.parametrize(
    ("then", "limit", "told"),
    [
        (nothing, {"seconds": 8}, "nothing came"),
        (zeros, {"seconds": 8}, r"\d+ bytes came"),
        (garbage, {"frames": 9}, r"\d+ bytes came"),
        (half_packets, {}, r"\d+ bytes came"),
    ],
)
def test_a_capture_without_a_frame_ends_and_leaves_nothing(impatient, tmp_path, then, limit, told):
    refused = pytest.raises(UserError, match=rf"no new frame in 0\.5 s, {told} instead; unplug")
    with acting(then) as port, refused:
        capture(lambda: port, tmp_path / "a", wanted(**limit), threading.Event())
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("what", [nothing, garbage, the_same_frame])
def test_a_capture_that_frames_leave_ends_and_keeps_them(impatient, tmp_path, what):
    out = tmp_path / "a"
    with (
        acting(frames_then(what)) as port,
        pytest.raises(UserError, match="no new frame") as refused,
    ):
        capture(lambda: port, out, wanted(frames=100), threading.Event())
    recording = open_recording(out)
    assert str(refused.value).endswith(f"; the {len(recording)} earlier frames are kept in {out}")
    # The first one was exposed before the settings held.
    assert len(recording) >= 19 and recording.settings.finished
