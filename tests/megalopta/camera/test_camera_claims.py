"""What a camera says of itself and cannot be is refused; its texts are shown, never obeyed."""

import threading

import pytest

from megalopta.camera.capturing import capture
from megalopta.camera.link import find_port, port_lines
from megalopta.camera.recording import open_recording
from megalopta.core.errors import UserError
from megalopta.sensor.formats.protocol import Identity, Kind, Settings, encode

from .conftest import wanted

ESCAPES = "\x1b[31mA\x07\x00\r\nB"


def frames(camera):
    while True:
        yield encode(camera.next_frame())


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
def test_what_no_camera_can_be_is_refused(acted, tmp_path, kind, field, value):
    refused = pytest.raises(UserError, match=f"the camera says {field} {value}.*; flash")
    with acted(frames, saying(kind, **{field: value})) as port, refused:
        capture(lambda: port, tmp_path / "a", wanted(frames=5), threading.Event())
    assert not (tmp_path / "a").exists()


def test_control_codes_of_a_serial_number_go_nowhere(acted, command, tmp_path):
    out = tmp_path / "a"
    answered = saying(Kind.IDENTITY, serial_number=ESCAPES, firmware="\x1b]0;x\x07")
    with acted(frames, answered) as port:
        words = ["--port", port, "--out", out, "--frames", 5, "--rate", 200, "--exposure", 0.005]
        with command("capture", *words) as running:
            printed, told = running.communicate(timeout=60)
    assert running.returncode == 0 and r"frames of \x1b[31mA\x07\x00\r\nB," in printed
    written = (out / "recording.yaml").read_text() + (out / "counts.zarr" / "zarr.json").read_text()
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


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"seconds": float("nan")}, "--"),
        ({"seconds": -1}, "--"),
        ({"frames": 0}, "--"),
        ({"frames": -(10**400)}, "--"),
        ({"exposure_s": float("nan")}, "--"),
        (
            {"exposure_s": 0.2, "frame_rate_hz": 10},
            "--exposure: 0.2 s is longer than a frame at --",
        ),
        ({"frame_rate_hz": 0}, "--rate: 0"),
        ({"frame_rate_hz": 1e300}, "--"),
        ({"step_bias": -1}, "--step-bias -1"),
        ({"row_window": (-1, 4)}, "--step-bias 2048, --rows -1 4"),
        ({"row_window": (3, 3)}, "--step-bias 2048, --rows 3 3"),
    ],
)
def test_settings_that_cannot_be_are_refused(fields, told, tmp_path):
    with pytest.raises(UserError, match=f"^{told}"):
        capture(lambda: "/none", tmp_path / "a", wanted(**fields), threading.Event())
    with pytest.raises(UserError, match="--wait: .*; give"):
        capture(lambda: "/none", tmp_path / "a", wanted(), threading.Event(), wait_s=float("inf"))


def test_control_codes_of_a_recording_are_escaped(acted, tmp_path):
    with acted(frames) as port:
        capture(lambda: port, tmp_path / "a", wanted(frames=5), threading.Event())
    path = tmp_path / "a" / "recording.yaml"
    path.write_text(path.read_text().replace("kind: flat", 'kind: "\\e[2J\\x07"'))
    assert open_recording(tmp_path / "a").kind == r"\x1b[2J\x07"
