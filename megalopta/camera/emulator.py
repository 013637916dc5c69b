"""An emulated camera: the sensor model behind SPADCAM's protocol, on a pseudo-terminal."""

import math
import os
import pty
import select
import threading
import time
import tty
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.capture import sensor_as_set
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError, refused_as
from megalopta.sensor import AnalogCounter, Sensor, changed, detection_rate, expose_adc, photon_rate
from megalopta.sensor.formats import protocol

BAND_NM = (699.99, 700.01)
"""Band of the flat light, narrow like a laser's, so that efficiency is that of one wavelength."""
BUFFER_BYTES = 24576 + 65536
"""Buffer of unread bytes, in the firmware and in the host's driver, which for a USB port has 64 KiB
and for a pseudo-terminal a sixth of it; a frame that does not fit is dropped."""


class Cycle(NamedTuple):
    """Detection rates of frames that repeat without end."""

    rates_hz: Floats
    """(n, rows, columns)"""
    frame_rate_hz: float

    def at(self, times_s: Floats) -> Floats:
        """Return the rates (n, 16, 16), Hz, of frames that begin at these times."""
        # A frame that begins early by a rounding error is not the previous one.
        places = np.floor(times_s * self.frame_rate_hz + 1e-6).astype(int)
        return np.asarray(self.rates_hz[places % len(self.rates_hz)])


Film = Callable[[Sensor], Cycle]
"""Light on a sensor; raises UserError"""


def flat(sensor: Sensor, photons_hz: tuple[float, ...] = (0.0,), step_s: float = math.inf) -> Cycle:
    """The same light on all pixels: none, one level, or a cycle of levels of this duration.

    `photons_hz` are photons per second on a pixel of pitch × pitch, at 700 nm.
    """
    light = np.ones((1, protocol.ROWS, protocol.COLUMNS, 1))
    detected_hz, photon_hz = (
        rate(light, (BAND_NM,), sensor) for rate in (detection_rate, photon_rate)
    )
    return Cycle(np.array(photons_hz)[:, None, None] * (detected_hz / photon_hz), 1 / step_s)


def plate(sensor: Sensor, speed_mm_s: float) -> Cycle:
    """The plate of the motion bench (§2.4.8), frame by frame at 10 per second.

    In its light an open pixel detects 65 photons in 0.1 s.
    """
    from megalopta.camera.motion_bench import FRAME_RATE_HZ, passing_rates

    as_lit = changed(sensor, exposure_s=1 / FRAME_RATE_HZ)
    return Cycle(passing_rates(speed_mm_s, as_lit), FRAME_RATE_HZ)


def rendered(sensor: Sensor, path: Path, lux: float | None = None) -> Cycle:
    """Frames of a dataset, at their rate: the middle square, averaged to 16 × 16.

    `lux` is the light level; default: that of the rendering.
    """
    from megalopta.dataset.frames import read_radiance_frame
    from megalopta.dataset.store import open_sequence

    dataset = open_sequence(path)
    configuration, camera = dataset.configuration, dataset.configuration.camera
    block = min(camera.height, camera.width) // protocol.ROWS
    if block == 0:
        raise UserError(f"{path}: smaller than 16 × 16 pixels; render it larger")
    side = block * protocol.ROWS
    top, left = (camera.height - side) // 2, (camera.width - side) // 2
    scale = 1.0 if lux is None else configuration.light_scale(lux)
    frames = []
    for index in range(configuration.trajectory.frames):
        image = read_radiance_frame(dataset, index)[top : top + side, left : left + side]
        blocks = image.reshape(protocol.ROWS, block, protocol.COLUMNS, block, -1)
        frames.append(blocks.mean(axis=(1, 3), dtype=np.float64) * scale)
    rates = detection_rate(np.array(frames), configuration.render.bands_nm, sensor)
    return Cycle(rates, configuration.trajectory.frame_rate_hz)


class EmulatedCamera:
    """Frames and replies as a function of sensor, film, seed and commands.

    A frame depends only on these, its number and the settings. Raises UserError if the sensor has
    no analog counters with an ADC, or cannot see the film.
    """

    def __init__(self, sensor: Sensor, film: Film, seed: int = 0) -> None:
        self.sensor, self.film, self.seed = sensor, film, seed
        self._number = self._start_us = 0
        self._set(protocol.Settings())

    @property
    def due_us(self) -> int:
        """Time of the next exposure by the camera's clock, µs."""
        return self._start_us + self.settings.exposure_us

    def answer(self, command: protocol.Packet, now_us: int) -> protocol.Packet:
        """Execute a command."""
        kinds = protocol.Kind
        if command.kind == kinds.IDENTIFY:
            counter = self.sensor.counter
            assert isinstance(counter, AnalogCounter) and counter.adc_bits
            adc = counter.adc_bits, round(counter.supply_v * 1000)
            name = f"emulated {self.sensor.name}".encode("ascii", "replace").decode("ascii")[:32]
            size = protocol.ROWS, protocol.COLUMNS
            payload = protocol.Identity(*size, *adc, "EMULATED", name).payload()
            return protocol.Packet(kinds.IDENTITY, command.sequence, now_us, payload)
        settings = self.settings.after(command)
        if not settings.refused:
            try:
                self._set(settings)
            except UserError:
                settings = self.settings._replace(refused=True)
        return protocol.Packet(kinds.SETTINGS, command.sequence, now_us, settings.payload())

    def next_frame(self) -> protocol.Packet:
        """Expose and read a frame."""
        if not self._drawn:
            self._drawn.extend(self._draw(self.settings, self._as_set, self._cycle))
        packet = protocol.frame_packet(self._number, self.due_us, self._drawn.popleft())
        self._number += 1
        self._start_us += self.settings.period_us
        return packet

    def _set(self, settings: protocol.Settings) -> None:
        sensor = sensor_as_set(self.sensor, settings)
        with refused_as(f"sensor {sensor.name}, emulated"):
            cycle = self.film(sensor)
            # Drawn at once, so that errors of the sensor show now.
            self._drawn = deque(self._draw(settings, sensor, cycle))
        self._as_set, self._cycle, self.settings = sensor, cycle, settings

    def _draw(
        self, settings: protocol.Settings, sensor: Sensor, cycle: Cycle
    ) -> NDArray[np.uint16]:
        """Draw the next frame and those after it that share its stream, from a fixed number on."""
        period_us = settings.period_us
        # frames of 64 ms share a stream
        together = int(np.clip(0.064 * 1e6 / period_us, 1, 64))
        gone = self._number % together
        numbers = np.arange(-gone, together - gone, dtype=np.float64)
        times_s = np.maximum(self._start_us + period_us * numbers, 0) * 1e-6
        stream = {"stream": 0, "first_frame": self._number - gone, "together": together}
        samples = expose_adc(cycle.at(times_s), sensor, seed=self.seed, **stream)[gone:]
        samples[:, : settings.first_row] = samples[:, settings.end_row :] = protocol.NOT_READ
        return samples


def emulate(
    camera: EmulatedCamera,
    stop: threading.Event,
    link: Path | None = None,
    plugged_in: Callable[[str], None] = lambda path: None,
    clock_rate: float = 1.0,
) -> int:
    """Send frames when they are due, and answer, until stopped; return the packets dropped.

    `link` is a symbolic link to the pseudo-terminal; `plugged_in` is called with its path. The
    camera's clock runs `clock_rate` times as fast as the host's.
    """
    if link is not None and link.exists() and not link.is_symlink():
        raise UserError(f"{link}: exists and is not a symbolic link; choose another name")
    parser, waiting, dropped = protocol.Parser(), bytearray(), 0
    # While the other end is open somewhere, writing to this one does not fail.
    end, other_end = pty.openpty()
    try:
        tty.setraw(other_end)
        os.set_blocking(end, False)
        path = os.ttyname(other_end)
        if link is not None:
            link.parent.mkdir(parents=True, exist_ok=True)
            link.unlink(missing_ok=True)
            link.symlink_to(path)
        plugged_in(path)
        start_s = time.monotonic()
        while not stop.is_set():
            now_us = int((time.monotonic() - start_s) * 1e6 * clock_rate)
            packets = [camera.next_frame()] if camera.due_us <= now_us else []
            pause_s = min(max((camera.due_us - now_us) * 1e-6 / clock_rate, 0.0), 0.05)
            ends = select.select([end], [end] if waiting else [], [], 0 if packets else pause_s)
            for command in parser.feed(os.read(end, 4096)) if ends[0] else ():
                if command.kind >= protocol.Kind.IDENTIFY:
                    now_us = int((time.monotonic() - start_s) * 1e6 * clock_rate)
                    packets.append(camera.answer(command, now_us))
            for line in map(protocol.encode, packets):
                if len(waiting) + len(line) <= BUFFER_BYTES:
                    waiting += line
                else:
                    dropped += 1
            if ends[1]:
                del waiting[: os.write(end, waiting)]
    finally:
        if link is not None:
            link.unlink(missing_ok=True)
        os.close(end)
        os.close(other_end)
    return dropped
