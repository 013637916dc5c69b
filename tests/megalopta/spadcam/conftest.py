"""An emulated camera on a real pseudo-terminal."""

import threading
import time
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from megalopta.sensor import expose_adc, preset
from megalopta.sensor.spadcam import Settings
from megalopta.spadcam import EmulatedCamera, EmulatedPort, Flat, sensor_as_set

SENSOR = preset("spadcam")
STIMULUS = Flat((5e6,))


@contextmanager
def emulating(link, faults=None, **camera):
    """Run a camera; `sent` holds its bytes, a bytearray for each time it was plugged in."""
    sent, stop = [], threading.Event()
    given = {"sensor": SENSOR, "stimulus": STIMULUS} | camera
    port = EmulatedPort(
        EmulatedCamera(**given),
        faults,
        link,
        lambda path: sent.append(bytearray()),
        lambda data: sent[-1].extend(data),
    )
    thread = threading.Thread(target=port.run, args=(stop,), daemon=True)
    thread.start()
    try:
        wait_for(link.exists)
        yield SimpleNamespace(sent=sent, find=lambda: str(link))
    finally:
        stop.set()
        thread.join(10)


def wait_for(condition, seconds=60):
    """Wait until something is so."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def expected_adc(settings: Settings, number: int, plugged_in: int = 0):
    """What the emulated camera reads in a frame, by the sensor model alone."""
    sensor = sensor_as_set(SENSOR, settings)
    # Frames of 64 ms, and at most 64, share a stream.
    together = min(max(64_000 // settings.period_us, 1), 64)
    place = number % together
    rate = STIMULUS.rates_hz(np.zeros(place + 1), sensor)
    drawn = {"seed": 0, "sequence": plugged_in, "together": together}
    return expose_adc(rate, sensor, first_frame=number - place, **drawn)[place]


@pytest.fixture
def emulated(tmp_path):
    """Emulates a camera at `tmp_path / "cam"`."""
    return partial(emulating, tmp_path / "cam")


@pytest.fixture
def expected():
    return expected_adc


@pytest.fixture
def until():
    return wait_for
