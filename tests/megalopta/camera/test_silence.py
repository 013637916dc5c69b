"""Captures of a camera that answers, and then sends no frames."""

import itertools
import threading

import numpy as np
import pytest

from megalopta.camera.capturing import capture
from megalopta.camera.recording import open_recording
from megalopta.core.errors import UserError
from megalopta.sensor.formats.protocol import LONGEST, encode

from .conftest import wanted

RNG = np.random.default_rng(0)
GARBAGE = RNG.integers(0, 256, 4096, np.uint8).tobytes()
PATIENCE_S = 0.5


def nothing(camera):
    yield from ()


def zeros(camera):
    yield from itertools.repeat(bytes(4096))


def garbage(camera):
    yield from itertools.repeat(GARBAGE)


def half_packets(camera):
    while True:
        yield encode(camera.next_frame())[:300]


def frames(camera, number=20):
    for _ in range(number):
        yield encode(camera.next_frame())


def the_same_frame(camera):
    line = [*frames(camera, 20)][-1]
    yield from itertools.repeat(line)


def frames_then(what):
    def then(camera):
        yield from frames(camera)
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
def test_a_capture_without_a_frame_ends_and_leaves_nothing(
    acted, impatient, tmp_path, then, limit, told
):
    refused = pytest.raises(UserError, match=rf"no new frame in 0\.5 s, {told} instead; unplug")
    with acted(then) as port, refused:
        capture(lambda: port, tmp_path / "a", wanted(**limit), threading.Event())
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("what", [nothing, garbage, the_same_frame])
def test_a_capture_that_frames_leave_ends_and_keeps_them(acted, impatient, tmp_path, what):
    out = tmp_path / "a"
    with (
        acted(frames_then(what)) as port,
        pytest.raises(UserError, match="no new frame") as refused,
    ):
        capture(lambda: port, out, wanted(frames=100), threading.Event())
    recording = open_recording(out)
    assert str(refused.value).endswith(f"; the {len(recording)} frames before are kept in {out}")
    # The first one was exposed before the settings held.
    assert len(recording) >= 19 and recording.settings.finished


def test_raw_bytes_are_bounded(acted, tmp_path, monkeypatch):
    monkeypatch.setattr("megalopta.camera.link.MOST_ELSE", 200_000)
    out = tmp_path / "a"
    with (
        acted(frames_then(garbage)) as port,
        pytest.raises(UserError, match="bytes came instead of frames"),
    ):
        capture(lambda: port, out, wanted(), threading.Event())
    frames_taken = len(open_recording(out))
    bound = 200_000 + 10 * frames_taken * (LONGEST + 1) + 65_536
    assert 200_000 < (out / "raw.bin").stat().st_size <= bound
