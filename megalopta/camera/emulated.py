"""An emulated camera: the sensor model behind SPADCAM's protocol, on a pseudo-terminal."""

import os
import pty
import select
import threading
import time
import tty
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.camera_settings import sensor_as_set
from megalopta.camera.stimuli import Stimulus
from megalopta.core.bounded import quoted
from megalopta.core.errors import UserError, refused_as
from megalopta.sensor import (
    AnalogCounter,
    Sensor,
    expose_adc,
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

_LARGEST_SEED = 2**63 - 1
_AHEAD_S = 0.064
_MOST_AHEAD = 64


class EmulatedCamera:
    """Frames and replies as a function of sensor, stimulus, seed and commands.

    A frame depends only on these, its number and the settings. Raises UserError if the sensor has
    no analog counters with an ADC, or cannot see the stimulus, or the seed is invalid.
    """

    settings: Settings

    def __init__(self, sensor: Sensor, stimulus: Stimulus, seed: int = 0) -> None:
        if not 0 <= seed <= _LARGEST_SEED:
            raise UserError(f"--seed: {quoted(seed)}; give 0 to {_LARGEST_SEED}")
        self.sensor, self.stimulus, self.seed = sensor, stimulus, seed
        self._number = self._start_us = 0
        self._set(Settings())

    @property
    def due_us(self) -> int:
        """Time of the next exposure by the camera's clock, µs."""
        return self._start_us + self.settings.exposure_us

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
                stream=0,
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
        return Identity(ROWS, COLUMNS, counter.adc_bits, supply_mv, "EMULATED", name)


BUFFER_BYTES = 24576 + 65536
"""Buffer of unread bytes, in the firmware and in the host's driver, which for a USB port has 64 KiB
and for a pseudo-terminal a sixth of it; a frame that does not fit is dropped."""

_LONGEST_WAIT_S = 0.05


class EmulatedPort:
    """A pseudo-terminal with an emulated camera behind it.

    `link` is a symbolic link to the terminal; `plugged_in` is called with its path, `sent` with the
    bytes that leave the camera. The camera's clock runs `clock_rate` times as fast as the host's.
    """

    def __init__(
        self,
        camera: EmulatedCamera,
        link: Path | None = None,
        plugged_in: Callable[[str], None] = lambda path: None,
        sent: Callable[[bytes], None] = lambda data: None,
        clock_rate: float = 1.0,
    ) -> None:
        if link is not None and link.exists() and not link.is_symlink():
            raise UserError(f"{link}: exists and is not a symbolic link; choose another name")
        self._camera, self._link, self._clock_rate = camera, link, clock_rate
        self._plugged_in, self._sent = plugged_in, sent
        self._waiting, self._start_s = bytearray(), 0.0
        self.dropped = 0
        """Packets that did not fit into the buffer."""

    def run(self, stop: threading.Event) -> None:
        """Serve until stopped."""
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

    def _serve(self, end: int, stop: threading.Event) -> None:
        """Send frames when they are due, and answer, until stopped."""
        parser, self._start_s = Parser(), time.monotonic()
        while not stop.is_set():
            if self._camera.due_us <= self._now_us():
                self._post(self._camera.next_frame())
            due_s = (self._camera.due_us - self._now_us()) * 1e-6 / self._clock_rate
            pause_s = min(max(due_s, 0.0), _LONGEST_WAIT_S)
            writing = [end] if self._waiting else []
            can_read, can_write, _ = select.select([end], writing, [], pause_s)
            for command in parser.feed(os.read(end, 4096)) if can_read else ():
                if command.kind >= Kind.IDENTIFY:
                    self._post(self._camera.answer(command, self._now_us()))
            if can_write:
                count = os.write(end, self._waiting)
                self._sent(bytes(self._waiting[:count]))
                del self._waiting[:count]

    def _now_us(self) -> int:
        return int((time.monotonic() - self._start_s) * 1e6 * self._clock_rate)

    def _post(self, packet: Packet) -> None:
        """Queue a packet, if it fits into the buffer."""
        line = encode(packet)
        if len(self._waiting) + len(line) <= BUFFER_BYTES:
            self._waiting += line
        else:
            self.dropped += 1
