"""Captures that are killed or find no room: all that they had read is on the disk and read back."""

import random
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from megalopta.camera.recorder import recover
from megalopta.camera.recording import open_recording
from megalopta.sensor.formats.protocol import Kind, Parser, encode, samples_of


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
def test_killed_at_any_moment_no_whole_packet_is_lost(acted, command, until, tmp_path):
    """15 kills; what was killed before the camera was set has recorded nothing."""
    rng, found = random.Random(0), 0
    for number in range(15):
        out = tmp_path / f"{number}"
        with acted(frames) as port, command("capture", *on(port, out)) as running:
            until((out / "raw.bin").exists)
            time.sleep(rng.choice([0.05, 0.5, 2, 5]) * rng.random())
            running.kill()
            assert running.wait(60) == -signal.SIGKILL
        if valid_frames(out / "raw.bin") and (out / "recording.yaml").exists():
            found += assert_nothing_lost(out).frames > 0
    assert found >= 8


def test_without_room_the_command_that_reads_back_is_named_and_works(acted, tmp_path):
    """No file may grow beyond 100 kB, as on a full disk."""
    out = tmp_path / "a b"
    run = "from megalopta.__main__ import main; main()"
    line = [sys.executable, "-c", run, "spadcam", "capture"]
    with acted(frames) as port:
        ended = subprocess.run(
            [*line, *map(str, on(port, out))],
            capture_output=True,
            text=True,
            timeout=120,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)),
        )
    told = ended.stderr.splitlines()[-1]
    assert ended.returncode == 2 and "the file grows larger than allowed" in told
    assert (out / "raw.bin").stat().st_size == 100_000  # to the last byte that there was room for
    if "recover" in told:
        assert told.endswith(f"read back what came: megalopta spadcam recover '{out}'")
        assert_nothing_lost(out)
    else:
        assert told.endswith(f"frames before are kept in {out}")
        # raw.bin may hold one more: the one that was being taken
        assert len(valid_frames(out / "raw.bin")) - len(open_recording(out)) in (0, 1)
