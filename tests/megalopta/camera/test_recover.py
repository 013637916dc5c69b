"""raw.bin read back: the same as what a capture makes of the same bytes."""

import shutil
import threading

import numpy as np
import pytest

from megalopta.camera.capturing import capture
from megalopta.camera.emulated import EmulatedCamera
from megalopta.camera.recording import open_recording
from megalopta.camera.recovering import recover
from megalopta.camera.replay import Told
from megalopta.camera.stimuli import Flat
from megalopta.camera.terminal import Faults
from megalopta.core.errors import UserError
from megalopta.sensor import open_counts, preset
from megalopta.sensor.formats.messages import samples_of
from megalopta.sensor.formats.packets import Kind, Packet, Parser, encode

from .conftest import emulating, wanted

EXACT = ("counts", "saturated", "adc", "device_us", "sequence_number")
TOLD = ("kind", "serial_number", "firmware", "exposure_s", "frame_rate_hz", "step_bias")


def stopped_after(frames):
    """Stops a capture from outside, so that it takes all that it has read."""
    stop = threading.Event()

    def show(state):
        if state.frames >= frames:
            stop.set()

    return stop, show


def arrays(path):
    opened = open_counts(path / "counts.zarr")
    return {name: np.asarray(opened.arrays[name][:]) for name in EXACT}


def assert_same_frames(first, second):
    for name, values in arrays(first).items():
        np.testing.assert_array_equal(values, arrays(second)[name], err_msg=name)


@pytest.fixture(scope="module")
def captured(tmp_path_factory):
    """A recording of a camera that is unplugged, on a line that damages some bytes."""
    folder = tmp_path_factory.mktemp("captured")
    faults = Faults(noise=5e-5, unplug_every_s=2.0, unplug_s=0.2)
    stop, show = stopped_after(600)
    settings = wanted(step_bias=3000, row_window=(2, 12))
    with emulating(folder / "cam", faults) as camera:
        capture(camera.find, folder / "a", settings, stop, show)
    return folder / "a"


def test_the_bytes_alone_make_the_same_frames(captured, tmp_path):
    shutil.copy(captured / "raw.bin", tmp_path / "dump.bin")
    path, _, unknown = recover(tmp_path / "dump.bin")
    assert path == tmp_path / "dump"
    assert_same_frames(captured, path)
    before, after = open_recording(captured).settings, open_recording(path).settings
    assert {name: getattr(before, name) for name in TOLD if name != "kind"} == {
        name: getattr(after, name) for name in TOLD if name != "kind"
    }
    assert (after.kind, after.recovered, after.finished) == ("unknown", True, True)
    assert (after.gaps, after.missing_frames) == (before.gaps, before.missing_frames)
    # Where the camera was unplugged, half a packet and the next one are one that is damaged.
    assert 0 <= after.damaged_packets - before.damaged_packets <= len(before.connections)
    assert len(unknown) == 2 and "--kind" in unknown[0] and "clock" in unknown[1]
    times_s = open_recording(path).times_s
    assert (np.diff(times_s) > 0).all()
    first = slice(0, before.connections[1].first_frame)
    np.testing.assert_allclose(
        np.diff(times_s[first]), np.diff(open_recording(captured).times_s[first]), rtol=2e-3
    )
    assert (path / "raw.bin").read_bytes() == (captured / "raw.bin").read_bytes()


def test_beside_recording_yaml_it_is_the_same_recording(captured, tmp_path):
    shutil.copytree(captured, tmp_path / "a")
    shutil.rmtree(tmp_path / "a" / "counts.zarr")
    path, _, unknown = recover(tmp_path / "a")
    assert path == tmp_path / "a" and unknown == ()
    assert_same_frames(captured, path)
    before = open_recording(captured)
    settings = open_recording(path).settings
    damaged = settings.damaged_packets
    same = before.settings.model_copy(update={"recovered": True, "damaged_packets": damaged})
    assert settings == same
    np.testing.assert_allclose(open_recording(path).times_s, before.times_s, atol=1e-9)
    assert {each.name for each in path.iterdir()} == {"counts.zarr", "raw.bin", "recording.yaml"}


def test_a_whole_recording_is_left_as_it_is(captured):
    with pytest.raises(UserError, match="is whole, with .* frames; give --out"):
        recover(captured)


def packets(number):
    camera = EmulatedCamera(preset("spadcam"), Flat((5e6,)))
    return b"".join(encode(camera.next_frame()) for _ in range(number))


def test_settings_that_the_bytes_do_not_say_are_asked_for(tmp_path):
    raw = tmp_path / "frames.bin"
    raw.write_bytes(packets(20))
    with pytest.raises(UserError, match="20 frames, but no reply.*give --exposure and --rate"):
        recover(raw)
    told = Told(kind="flat", exposure_s=0.05, frame_rate_hz=10)
    path, record, unknown = recover(raw, told=told)
    assert record.frames == 20 and record.exposure_s == 0.05 and record.kind == "flat"
    assert unknown == (
        "the camera's own settings",
        "the camera",
        "the host's clock (times are the camera's)",
    )
    logged = [samples_of(each) for each in Parser().feed(raw.read_bytes())]
    np.testing.assert_array_equal(open_recording(path).adc[:], logged)


@pytest.mark.parametrize("content", [b"", bytes(10_000), b"temperature 21.5\r\n" * 1000])
def test_what_holds_no_frames_is_told_and_makes_nothing(tmp_path, content):
    (tmp_path / "a.bin").write_bytes(content)
    with pytest.raises(UserError, match="no frame of SPADCAM in its"):
        recover(tmp_path / "a.bin")
    assert [each.name for each in tmp_path.iterdir()] == ["a.bin"]


def test_two_recordings_in_one_file_are_told(captured, tmp_path):
    other = bytearray()
    camera = EmulatedCamera(preset("spadcam"), Flat(), serial_number="B")
    for kind in (Kind.IDENTIFY, *[Kind.SET_STEP_BIAS] * 5):
        payload = b"" if kind == Kind.IDENTIFY else (2048).to_bytes(2, "little")
        other += encode(camera.answer(Packet(kind, 1, 0, payload), 0))
    raw = tmp_path / "both.bin"
    raw.write_bytes((captured / "raw.bin").read_bytes() + b"\0" + other + packets(40))
    with pytest.raises(UserError, match=r"two recordings: from byte \d+ on"):
        recover(raw)


def test_fewer_frames_than_there_are_replace_nothing(captured, tmp_path):
    shutil.copytree(captured, tmp_path / "a")
    settings = (tmp_path / "a" / "recording.yaml").read_text("utf-8")
    (tmp_path / "a" / "recording.yaml").write_text(
        settings.replace("finished: true", "finished: false")
    )
    with (tmp_path / "a" / "raw.bin").open("r+b") as file:
        file.truncate(60_000)
    with pytest.raises(UserError, match=r"holds \d+ frames, raw.bin only \d+; give --out"):
        recover(tmp_path / "a")
    assert_same_frames(captured, tmp_path / "a")
