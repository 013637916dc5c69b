"""A camera that is not there: the full sensor model behind SPADCAM's protocol, without a line."""

import re
from collections import deque
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.camera_settings import sensor_as_set
from megalopta.core.bounded import quoted
from megalopta.core.errors import UserError
from megalopta.sensor import AnalogCounter, Sensor, expose_adc
from megalopta.sensor.formats.protocol import (
    COLUMNS,
    NOT_READ,
    ROWS,
    Identity,
    Kind,
    Packet,
    Settings,
    frame_packet,
)

if TYPE_CHECKING:
    from megalopta.camera.stimuli import Stimulus

_LARGEST_SEED = 2**63 - 1
_AHEAD_S = 0.064
_MOST_AHEAD = 64


class EmulatedCamera:
    """Frames and replies as a function of sensor, stimulus, seed and commands.

    Parameters
    ----------
    sensor : Sensor
        With analog counters and an ADC.
    stimulus : Stimulus
    seed : int
        Of photons and noise; a frame depends on nothing else but its number, the settings, and how
        often the camera was plugged in.
    serial_number : str
        At most 16 letters of ASCII.

    Raises
    ------
    UserError
        When the sensor has no ADC, or cannot see the stimulus, or seed or serial number cannot be.
    """

    settings: Settings

    def __init__(
        self, sensor: Sensor, stimulus: "Stimulus", seed: int = 0, serial_number: str = "EMULATED"
    ) -> None:
        if not 0 <= seed <= _LARGEST_SEED:
            raise UserError(f"--seed: {quoted(seed)}; give 0 to {_LARGEST_SEED}")
        if not re.fullmatch(r"[!-~]([ -~]{0,14}[!-~])?", serial_number):
            raise UserError(f"--serial: {quoted(serial_number)!r}; give 1 to 16 letters of ASCII")
        self.sensor, self.stimulus, self.seed = sensor, stimulus, seed
        self.serial_number = serial_number
        self._plugged_in = 0
        self._number = 0
        self._start_us = 0
        self._set(Settings())

    @property
    def due_us(self) -> int:
        """When the next frame is exposed, by the camera's clock, µs."""
        return self._start_us + self.settings.exposure_us

    def restart(self) -> None:
        """Begin anew, as when plugged in: counter, clock and settings."""
        self._plugged_in += 1
        self._number = self._start_us = 0
        self._set(Settings())

    def answer(self, command: Packet, now_us: int) -> Packet:
        """Do what a command asks for. Raises ValueError when it is no command."""
        if command.kind < Kind.IDENTIFY:
            raise ValueError(f"{command.kind.name}: no command")
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
        # Drawn at once: what the sensor cannot do shows now.
        self._drawn = deque(self._draw(settings, as_set))
        self._as_set, self.settings = as_set, settings

    def _draw(self, settings: Settings, sensor: Sensor) -> NDArray[np.uint16]:
        """Draw the next frame and those after it, as many as share a stream.

        Streams begin at fixed numbers, so that frames do not depend on when the settings came.
        """
        period_us = settings.period_us
        together = int(np.clip(_AHEAD_S * 1e6 / period_us, 1, _MOST_AHEAD))
        gone = self._number % together
        numbers = np.arange(-gone, together - gone, dtype=np.float64)
        times_s = np.maximum(self._start_us + period_us * numbers, 0) * 1e-6
        try:
            samples = expose_adc(
                self.stimulus.rates_hz(times_s, sensor),
                sensor,
                seed=self.seed,
                sequence=self._plugged_in,
                first_frame=self._number - gone,
                together=together,
            )[gone:]
        except ValueError as problem:
            raise UserError(f"sensor {sensor.name}, emulated: {problem}") from None
        samples[:, : settings.first_row] = NOT_READ
        samples[:, settings.end_row :] = NOT_READ
        return samples

    def _identity(self) -> Identity:
        counter = self.sensor.counter
        assert isinstance(counter, AnalogCounter) and counter.adc_bits
        supply_mv = round(counter.supply_v * 1000)
        name = f"emulated {self.sensor.name}".encode("ascii", "replace").decode("ascii")[:32]
        return Identity(ROWS, COLUMNS, counter.adc_bits, supply_mv, self.serial_number, name)
