"""An emulated camera on a real pseudo-terminal."""

import os
import pty
import select
import subprocess
import sys
import threading
import tty
from contextlib import contextmanager, suppress
from functools import partial

import numpy as np
import pytest

from megalopta.camera.capture import CaptureSettings, sensor_as_set
from megalopta.camera.emulator import EmulatedCamera, emulate, flat
from megalopta.sensor import expose_adc, preset
from megalopta.sensor.formats.protocol import Kind, Parser, Settings, encode

from ..process_group import wait_for

SENSOR = preset("spadcam")
FILM = partial(flat, photons_hz=(5e6,))


@contextmanager
def emulating(link, clock_rate=1.0, **fields):
    """Run a camera; yield a function that finds its port."""
    stop = threading.Event()
    camera = EmulatedCamera(**{"sensor": SENSOR, "film": FILM, **fields})
    acts = partial(emulate, camera, stop, link, clock_rate=clock_rate)
    thread = threading.Thread(target=acts, daemon=True)
    thread.start()
    try:
        wait_for(link.exists)
        yield lambda: str(link)
    finally:
        stop.set()
        thread.join(10)


@contextmanager
def acting(then, answered=lambda packet: packet):
    """A terminal with a camera that answers, and, once it is set, sends what `then` yields.

    `then` gets the camera and yields bytes; `answered` may change its replies.
    """
    end, other_end = pty.openpty()
    tty.setraw(other_end)
    os.set_blocking(end, False)
    stop = threading.Event()
    camera = EmulatedCamera(SENSOR, FILM)  # takes a while
    acts = partial(_act, end, camera, then, answered, stop)
    thread = threading.Thread(target=acts, daemon=True)
    thread.start()
    try:
        yield os.ttyname(other_end)
    finally:
        stop.set()
        thread.join(10)
        os.close(end)
        os.close(other_end)


def _act(end, camera, then, answered, stop):
    parser, sending, waiting = Parser(), iter(()), b""
    while not stop.is_set():
        if select.select([end], [], [], 0.001)[0]:
            for command in parser.feed(os.read(end, 4096)):
                waiting += encode(answered(camera.answer(command, camera.due_us)))
                if command.kind == Kind.SET_ROW_WINDOW:
                    sending = then(camera)
        waiting = waiting or next(sending, b"")
        with suppress(BlockingIOError):
            waiting = waiting[os.write(end, waiting) :]


def frames(camera):
    """Yield the lines of a camera's frames."""
    while True:
        yield encode(camera.next_frame())


def wanted(**fields):
    """Settings of a fast capture, but for these fields."""
    given = {"exposure_s": 0.005, "frame_rate_hz": 200, "step_bias": 2048, "row_window": (0, 16)}
    return CaptureSettings(**{"sensor": preset("spadcam"), "kind": "flat", **given, **fields})


RUN = "from megalopta.__main__ import main; main()"


@contextmanager
def running(*words):
    """A verb of `megalopta spadcam` in a process of its own."""
    line = [sys.executable, "-c", RUN, "spadcam", *map(str, words)]
    pipe = subprocess.PIPE
    with subprocess.Popen(line, stdout=pipe, stderr=pipe, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def expected_adc(settings: Settings, number: int):
    """What the emulated camera reads in a frame, by the sensor model alone."""
    sensor = sensor_as_set(SENSOR, settings)
    # Frames of 64 ms, and at most 64, share a stream.
    together = min(max(64_000 // settings.period_us, 1), 64)
    place = number % together
    rate = FILM(sensor).at(np.zeros(place + 1))
    drawn = {"seed": 0, "stream": 0, "together": together}
    return expose_adc(rate, sensor, first_frame=number - place, **drawn)[place]


@pytest.fixture
def emulated(tmp_path):
    """Emulates a camera at `tmp_path / "cam"`."""
    return partial(emulating, tmp_path / "cam")
