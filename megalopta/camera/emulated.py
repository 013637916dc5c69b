"""An emulated camera: the sensor model behind SPADCAM's protocol, on a pseudo-terminal.

It sees uniform light, the plate of the motion bench or a rendered dataset; the last two load scenes
and the renderer on first use. Its line may have faults.
"""

import math
import os
import pty
import re
import select
import threading
import time
import tty
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.camera_settings import sensor_as_set
from megalopta.core.arrays import Floats
from megalopta.core.bounded import quoted
from megalopta.core.errors import UserError, refused_as
from megalopta.sensor import (
    AnalogCounter,
    Sensor,
    changed,
    detection_rate,
    expose_adc,
    generator,
    photon_rate,
)
from megalopta.sensor.formats.protocol import (
    COLUMNS,
    NOT_READ,
    ROWS,
    Identity,
    Kind,
    Packet,
    Parser,
    Settings,
    encode,
    frame_packet,
)

BAND_NM = (699.99, 700.01)
"""Band of the flat light, narrow like a laser's, so that efficiency is that of one wavelength."""


class Cycle(NamedTuple):
    """Detection rates of frames that repeat."""

    rates_hz: Floats
    """(n, rows, columns)"""
    frame_rate_hz: float


class Stimulus(ABC):
    """A stimulus: frames in an endless cycle."""

    @abstractmethod
    def film(self, sensor: Sensor) -> Cycle:
        """Return the frames (n, 16, 16). Raises UserError."""

    def rates_hz(self, times_s: Floats, sensor: Sensor) -> Floats:
        """Detection rates (n, 16, 16), Hz, of frames that begin at these times."""
        frames, rate_hz = self.film(sensor)
        # A frame that begins early by a rounding error is not the previous one.
        return np.asarray(frames[np.floor(times_s * rate_hz + 1e-6).astype(int) % len(frames)])


@dataclass(frozen=True)
class Flat(Stimulus):
    """The same light on all pixels: none, one level, or a cycle of levels."""

    photons_hz: tuple[float, ...] = (0.0,)
    """Photons per second on a pixel of pitch × pitch, at 700 nm; levels in a cycle."""
    step_s: float = math.inf
    """Duration of each level, s."""

    def film(self, sensor: Sensor) -> Cycle:
        """Return a frame for each level."""
        rates_hz = np.array(self.photons_hz)[:, None, None] * _efficiency(sensor)
        return Cycle(rates_hz, 1 / self.step_s)


@cache
def _efficiency(sensor: Sensor) -> Floats:
    """Return the detected share of the photons on each pixel, (16, 16)."""
    light = np.ones((1, ROWS, COLUMNS, 1))
    photons = photon_rate(light, (BAND_NM,), sensor)
    return np.asarray((detection_rate(light, (BAND_NM,), sensor) / photons)[0])


@dataclass(frozen=True)
class Plate(Stimulus):
    """The plate of the motion bench (§2.4.8), frame by frame at 10 per second.

    In its light an open pixel detects 65 photons in 0.1 s.
    """

    speed_mm_s: float

    def film(self, sensor: Sensor) -> Cycle:
        """Return the frames of a passage to and fro."""
        return _passing(self.speed_mm_s, sensor)


@cache
def _passing(speed_mm_s: float, sensor: Sensor) -> Cycle:
    from megalopta.camera.motion_bench import FRAME_RATE_HZ, passing_rates

    as_lit = changed(sensor, exposure_s=1 / FRAME_RATE_HZ)
    return Cycle(passing_rates(speed_mm_s, as_lit), FRAME_RATE_HZ)


@dataclass(frozen=True)
class Rendered(Stimulus):
    """Frames of a dataset, at their rate: the middle square, averaged to 16 × 16."""

    path: Path
    lux: float | None = None
    """Light level; default: that of the rendering."""

    def film(self, sensor: Sensor) -> Cycle:
        """Return the frames of the dataset, which must be readable and large enough."""
        frame_rate_hz, frames, bands = _rendered(self)
        return Cycle(detection_rate(frames, bands, sensor), frame_rate_hz)


@cache
def _rendered(scene: Rendered) -> tuple[float, Floats, tuple[tuple[float, float], ...]]:
    from megalopta.config.light_scale import light_scale
    from megalopta.dataset.frames import read_radiance_frame
    from megalopta.dataset.store import open_sequence

    dataset = open_sequence(scene.path)
    configuration = dataset.configuration
    side = min(configuration.camera.height, configuration.camera.width) // ROWS * ROWS
    if side == 0:
        raise UserError(f"{scene.path}: smaller than 16 × 16 pixels; render it larger")
    scale = 1.0 if scene.lux is None else light_scale(configuration, scene.lux)
    frames = [
        _shrunk(read_radiance_frame(dataset, index), side) * scale
        for index in range(configuration.trajectory.frames)
    ]
    bands = configuration.render.bands_nm
    return configuration.trajectory.frame_rate_hz, np.array(frames, np.float64), bands


def _shrunk(image: NDArray[np.float32], side: int) -> Floats:
    """Return the mean over the blocks of the middle square, (16, 16, B)."""
    top, left = ((length - side) // 2 for length in image.shape[:2])
    block = side // ROWS
    square = image[top : top + side, left : left + side]
    blocks = square.reshape(ROWS, block, COLUMNS, block, -1)
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float64))


_LARGEST_SEED = 2**63 - 1
_AHEAD_S = 0.064
_MOST_AHEAD = 64


class EmulatedCamera:
    """Frames and replies as a function of sensor, stimulus, seed and commands.

    A frame depends only on these, its number, the settings, and how often the camera was plugged
    in. Raises UserError if the sensor has no analog counters with an ADC, or cannot see the
    stimulus, or seed or serial number (at most 16 ASCII characters) are invalid.
    """

    settings: Settings

    def __init__(
        self, sensor: Sensor, stimulus: Stimulus, seed: int = 0, serial_number: str = "EMULATED"
    ) -> None:
        if not 0 <= seed <= _LARGEST_SEED:
            raise UserError(f"--seed: {quoted(seed)}; give 0 to {_LARGEST_SEED}")
        if not re.fullmatch(r"[!-~]([ -~]{0,14}[!-~])?", serial_number):
            raise UserError(f"--serial: {quoted(serial_number)!r}; give 1 to 16 ASCII characters")
        self.sensor, self.stimulus, self.seed = sensor, stimulus, seed
        self.serial_number = serial_number
        self._plugged_in = 0
        self._number = 0
        self._start_us = 0
        self._set(Settings())

    @property
    def due_us(self) -> int:
        """Time of the next exposure by the camera's clock, µs."""
        return self._start_us + self.settings.exposure_us

    def restart(self) -> None:
        """Reset counter, clock and settings, as after plugging in."""
        self._plugged_in += 1
        self._number = self._start_us = 0
        self._set(Settings())

    def answer(self, command: Packet, now_us: int) -> Packet:
        """Execute a command. Raises ValueError if it is not a command."""
        if command.kind < Kind.IDENTIFY:
            raise ValueError(f"{command.kind.name}: not a command")
        if command.kind == Kind.IDENTIFY:
            return Packet(Kind.IDENTITY, command.sequence, now_us, self._identity().payload())
        settings = self.settings.after(command)
        if not settings.refused:
            try:
                self._set(settings)
            except UserError:
                settings = self.settings._replace(refused=True)
        return Packet(Kind.SETTINGS, command.sequence, now_us, settings.payload())

    def next_frame(self) -> Packet:
        """Expose and read a frame."""
        if not self._drawn:
            self._drawn.extend(self._draw(self.settings, self._as_set))
        packet = frame_packet(self._number, self.due_us, self._drawn.popleft())
        self._number += 1
        self._start_us += self.settings.period_us
        return packet

    def _set(self, settings: Settings) -> None:
        as_set = sensor_as_set(self.sensor, settings)
        # Drawn at once, so that errors of the sensor show now.
        self._drawn = deque(self._draw(settings, as_set))
        self._as_set, self.settings = as_set, settings

    def _draw(self, settings: Settings, sensor: Sensor) -> NDArray[np.uint16]:
        """Draw the next frame and those after it that share its stream.

        Streams begin at fixed numbers, so that frames do not depend on the time of the settings.
        """
        period_us = settings.period_us
        together = int(np.clip(_AHEAD_S * 1e6 / period_us, 1, _MOST_AHEAD))
        gone = self._number % together
        numbers = np.arange(-gone, together - gone, dtype=np.float64)
        times_s = np.maximum(self._start_us + period_us * numbers, 0) * 1e-6
        with refused_as(f"sensor {sensor.name}, emulated"):
            samples = expose_adc(
                self.stimulus.rates_hz(times_s, sensor),
                sensor,
                seed=self.seed,
                stream=self._plugged_in,
                first_frame=self._number - gone,
                together=together,
            )[gone:]
        samples[:, : settings.first_row] = NOT_READ
        samples[:, settings.end_row :] = NOT_READ
        return samples

    def _identity(self) -> Identity:
        counter = self.sensor.counter
        assert isinstance(counter, AnalogCounter) and counter.adc_bits
        supply_mv = round(counter.supply_v * 1000)
        name = f"emulated {self.sensor.name}".encode("ascii", "replace").decode("ascii")[:32]
        return Identity(ROWS, COLUMNS, counter.adc_bits, supply_mv, self.serial_number, name)


BUFFER_BYTES = 24576 + 65536
"""Buffer of unread bytes, in the firmware and in the host's driver, which for a USB port has 64 KiB
and for a pseudo-terminal a sixth of it; a frame that does not fit is dropped."""

_LONGEST_WAIT_S = 0.05
_A_DAY_S = 86400.0
_LIMITS = {"noise": (0.0, 1.0), "lost": (0.0, 1.0), "drift_ppm": (-9e5, 1e8)}
_TIMES = (1e-3, _A_DAY_S)
"""Limits of all other faults, s, if not 0."""


@dataclass(frozen=True)
class Faults:
    """Faults of the line."""

    noise: float = 0.0
    lost: float = 0.0
    """Probability that a byte has a flipped bit, or is lost."""
    burst_s: float = 0.0
    """Interval at which held-back bytes are sent at once, s."""
    drift_ppm: float = 0.0
    """Relative error of the camera's clock, positive if fast, 1e-6."""
    stall_every_s: float = 0.0
    stall_s: float = 0.0
    """Interval and duration of stops, s."""
    unplug_every_s: float = 0.0
    unplug_s: float = 0.5
    """Time plugged in, and time unplugged, s."""

    def check(self) -> None:
        """Check the values. Raises UserError."""
        for name, value in vars(self).items():
            least, most = _LIMITS.get(name, _TIMES)
            if value != 0 and not least <= value <= most:
                raise UserError(
                    f"--{name.replace('_', '-')}: {value:g}; give 0, or {least:g} to {most:g}"
                )
        if self.stall_every_s and self.stall_s >= self.stall_every_s:
            raise UserError(
                f"--stall-s: {self.stall_s:g}; give less than --stall-every-s, "
                f"{self.stall_every_s:g}"
            )

    def on(self, line: bytes, seed: int, packet: Packet) -> bytes:
        """Return the bytes of a packet that arrive."""
        if not self.noise and not self.lost:
            return line
        rng = generator(seed, "line", packet.kind, packet.sequence)
        data = np.frombuffer(line, np.uint8)
        flips = np.uint8(1) << rng.integers(0, 8, data.size, np.uint8)
        noisy = np.where(rng.random(data.size) < self.noise, data ^ flips, data)
        return noisy[rng.random(data.size) >= self.lost].tobytes()


class EmulatedPort:
    """A pseudo-terminal with an emulated camera behind it.

    The terminal's name may change when the camera is unplugged and plugged in again; `link` is a
    symbolic link to it. `plugged_in` is called with the terminal's path each time, `sent` with the
    bytes that leave the camera.
    """

    def __init__(
        self,
        camera: EmulatedCamera,
        faults: Faults | None = None,
        link: Path | None = None,
        plugged_in: Callable[[str], None] = lambda path: None,
        sent: Callable[[bytes], None] = lambda data: None,
    ) -> None:
        if link is not None and link.exists() and not link.is_symlink():
            raise UserError(f"{link}: exists and is not a symbolic link; choose another name")
        self._camera, self._faults, self._link = camera, faults or Faults(), link
        self._faults.check()
        self._plugged_in, self._sent = plugged_in, sent
        self._waiting, self._start_s = bytearray(), 0.0
        self.dropped = 0
        """Packets that did not fit into the buffer."""

    def run(self, stop: threading.Event) -> None:
        """Serve until stopped, plugged in and out as the faults define."""
        while not stop.is_set():
            # While the other end is open somewhere, writing to this one does not fail.
            end, other_end = pty.openpty()
            try:
                tty.setraw(other_end)
                os.set_blocking(end, False)
                path = os.ttyname(other_end)
                if self._link is not None:
                    self._link.parent.mkdir(parents=True, exist_ok=True)
                    self._link.unlink(missing_ok=True)
                    self._link.symlink_to(path)
                self._plugged_in(path)
                self._serve(end, stop)
            finally:
                if self._link is not None:
                    self._link.unlink(missing_ok=True)
                os.close(end)
                os.close(other_end)
            if not stop.wait(self._faults.unplug_s):
                self._camera.restart()

    def _serve(self, end: int, stop: threading.Event) -> None:
        """Send frames when they are due, and answer, until stopped or unplugged."""
        parser, life_s = Parser(), self._faults.unplug_every_s or float("inf")
        self._waiting, self._start_s = bytearray(), time.monotonic()
        while not stop.is_set() and self._elapsed_s() < life_s:
            if self._camera.due_us <= self._now_us():
                self._post(self._camera.next_frame())
            may_send = bool(self._waiting) and self._may_send()
            due_s = max((self._camera.due_us - self._now_us()) * 1e-6, 0.0)
            # until the next frame, or until held-back bytes are due
            pause_s = min(due_s, 2e-3 if self._waiting and not may_send else _LONGEST_WAIT_S)
            can_read, can_write, _ = select.select([end], [end] if may_send else [], [], pause_s)
            for command in parser.feed(os.read(end, 4096)) if can_read else ():
                if command.kind >= Kind.IDENTIFY:
                    self._post(self._camera.answer(command, self._now_us()))
            if can_write:
                count = os.write(end, self._waiting)
                self._sent(bytes(self._waiting[:count]))
                del self._waiting[:count]

    def _elapsed_s(self) -> float:
        return time.monotonic() - self._start_s

    def _now_us(self) -> int:
        return int(self._elapsed_s() * (1e6 + self._faults.drift_ppm))

    def _post(self, packet: Packet) -> None:
        """Queue a packet, if it fits into the buffer."""
        line = encode(packet)
        if len(self._waiting) + len(line) <= BUFFER_BYTES:
            self._waiting += self._faults.on(line, self._camera.seed, packet)
        else:
            self.dropped += 1

    def _may_send(self) -> bool:
        faults, now_s = self._faults, self._elapsed_s()
        sending_s = faults.stall_every_s - faults.stall_s
        if faults.stall_every_s and now_s % faults.stall_every_s > sending_s:
            return False
        return not faults.burst_s or now_s % faults.burst_s < 0.2 * faults.burst_s
