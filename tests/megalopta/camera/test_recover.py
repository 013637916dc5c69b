"""raw.bin read back: the same as what a capture makes of the same bytes.

Of captures that are killed or find no room, all that they had read is on the disk.
"""

import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from megalopta.camera.capturing import capture, recorded_line
from megalopta.camera.emulated import Faults
from megalopta.camera.recorder import recover
from megalopta.camera.recording import open_recording
from megalopta.core.errors import UserError
from megalopta.sensor import open_counts
from megalopta.sensor.formats.protocol import Kind, Parser, encode, samples_of

from ..process_group import wait_for
from .conftest import RUN, acting, emulating, running, wanted

EXACT = ("counts", "saturated", "adc", "device_us", "sequence_number")


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


def test_beside_recording_yaml_it_is_the_same_recording(captured, tmp_path):
    shutil.copytree(captured, tmp_path / "a")
    shutil.rmtree(tmp_path / "a" / "counts.zarr")
    path, _ = recover(tmp_path / "a")
    assert path == tmp_path / "a"
    assert_same_frames(captured, path)
    before = open_recording(captured)
    settings = open_recording(path).settings
    damaged = settings.damaged_packets
    same = before.settings.model_copy(update={"recovered": True, "damaged_packets": damaged})
    assert settings == same
    np.testing.assert_allclose(open_recording(path).times_s, before.times_s, atol=1e-9)
    assert {each.name for each in path.iterdir()} == {"counts.zarr", "raw.bin", "recording.yaml"}


def test_a_whole_recording_is_left_as_it_is(captured):
    with pytest.raises(UserError, match="is complete, with .* frames; give --out"):
        recover(captured)


def test_without_its_clocks_times_are_the_cameras(captured, tmp_path):
    shutil.copytree(captured, tmp_path / "a")
    path = tmp_path / "a" / "recording.yaml"
    text = path.read_text("utf-8").replace("finished: true", "finished: false")
    path.write_text(re.sub(r"(offset_s|rate|error_s): .*", r"\1: null", text))
    _, record = recover(tmp_path / "a", tmp_path / "b")
    assert_same_frames(captured, tmp_path / "b")
    assert (tmp_path / "b" / "raw.bin").read_bytes() == (captured / "raw.bin").read_bytes()
    times_s, exact_s = open_recording(tmp_path / "b").times_s, open_recording(captured).times_s
    assert (np.diff(times_s) > 0).all()
    first = slice(0, record.connections[1].first_frame)
    np.testing.assert_allclose(np.diff(times_s[first]), np.diff(exact_s[first]), rtol=2e-3)
    assert "times by the camera's clock alone" in recorded_line(path, record)


@pytest.mark.parametrize("content", [b"", bytes(10_000), b"temperature 21.5\r\n" * 1000])
def test_what_holds_no_frames_is_told_and_changes_nothing(captured, tmp_path, content):
    (tmp_path / "a").mkdir()
    shutil.copy(captured / "recording.yaml", tmp_path / "a")
    (tmp_path / "a" / "raw.bin").write_bytes(content)
    with pytest.raises(UserError, match="no frame of SPADCAM in its"):
        recover(tmp_path / "a")
    assert sorted(each.name for each in (tmp_path / "a").iterdir()) == ["raw.bin", "recording.yaml"]


def test_bytes_alone_are_no_recording(captured, tmp_path):
    shutil.copy(captured / "raw.bin", tmp_path)
    with pytest.raises(UserError, match=r"no recording\.yaml next to raw\.bin"):
        recover(tmp_path / "raw.bin")


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


def on(port, out):
    return ["--port", port, "--out", out, "--rate", "200", "--exposure", "0.005"]


def frames(camera):
    while True:
        time.sleep(0.004)
        yield encode(camera.next_frame())


def valid_frames(raw):
    """Frames of the raw bytes that a capture takes: exposed after the last reply."""
    packets = list(Parser().feed(raw.read_bytes()))
    replies = [each.device_us for each in packets if each.kind == Kind.SETTINGS]
    if len(replies) < 5:
        return []
    valid_us = replies[-1] + 5000
    return [each for each in packets if each.kind == Kind.FRAME and each.device_us >= valid_us]


def assert_nothing_lost(out):
    valid = valid_frames(out / "raw.bin")
    path, record = recover(out)
    recording = open_recording(path)
    assert record.frames == len(recording) == len(valid)
    numbers = [each.sequence for each in valid]
    np.testing.assert_array_equal(recording.sequence_number, numbers)
    np.testing.assert_array_equal(recording.adc[:], [samples_of(each) for each in valid])
    assert {each.name for each in out.iterdir()} == {"counts.zarr", "raw.bin", "recording.yaml"}
    return record


@pytest.mark.slow
def test_killed_at_any_moment_no_whole_packet_is_lost(tmp_path):
    """15 kills; what was killed before the camera was set has recorded nothing."""
    rng, found = random.Random(0), 0
    for number in range(15):
        out = tmp_path / f"{number}"
        with acting(frames) as port, running("capture", *on(port, out)) as process:
            wait_for((out / "raw.bin").exists)
            time.sleep(rng.choice([0.05, 0.5, 2, 5]) * rng.random())
            process.kill()
            assert process.wait(60) == -signal.SIGKILL
        if valid_frames(out / "raw.bin") and (out / "recording.yaml").exists():
            found += assert_nothing_lost(out).frames > 0
    assert found >= 8


def test_without_room_the_command_that_reads_back_is_named_and_works(tmp_path):
    """No file may grow beyond 100 kB, as on a full disk."""
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
    assert (out / "raw.bin").stat().st_size == 100_000  # to the last byte that there was room for
    if "recover" in told:
        assert told.endswith(f"recover the frames: megalopta spadcam recover '{out}'")
        assert_nothing_lost(out)
    else:
        assert told.endswith(f"earlier frames are kept in {out}")
        # raw.bin may hold one more: the one that was being taken
        assert len(valid_frames(out / "raw.bin")) - len(open_recording(out)) in (0, 1)
