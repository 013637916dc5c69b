"""Settings of a camera, and the sensor that they make: by name, with its settings and its ADC."""

import math
from dataclasses import dataclass

from megalopta.camera.recording import check_kind
from megalopta.core.bounded import quoted
from megalopta.core.errors import UserError, refused_as
from megalopta.sensor import AnalogCounter, Sensor, changed, load_sensor, preset
from megalopta.sensor.formats.protocol import COLUMNS, NOMINAL_STEP_BIAS, ROWS, Identity, Settings

_POSSIBLE = {
    "rows": (ROWS, ROWS),
    "columns": (COLUMNS, COLUMNS),
    "adc_bits": (1, 16),
    "supply_mv": (1000, 6000),
}
"""Possible values of the camera's identity."""


def named_sensor(name: str) -> Sensor:
    """Return a preset, or the sensor of a YAML file. Raises UserError."""
    with refused_as("--sensor"):
        return load_sensor(name) if name.endswith((".yaml", ".yml")) else preset(name)


def sensor_as_set(sensor: Sensor, settings: Settings) -> Sensor:
    """Return a sensor with the camera's exposure, and a step proportional to the bias (assumed).

    Raises UserError if the sensor does not allow these values, or its counters have no ADC.
    """
    counter = sensor.counter
    if not isinstance(counter, AnalogCounter) or not 0 < (counter.adc_bits or 0) <= 16:
        raise UserError(
            f"sensor {sensor.name}: its counters have no ADC of 1 to 16 bits; "
            "choose another, such as spadcam"
        )
    step_v = counter.step_v * settings.step_bias / NOMINAL_STEP_BIAS
    with refused_as(f"sensor {sensor.name}"):
        return changed(sensor, exposure_s=settings.exposure_us / 1e6, counter={"step_v": step_v})


def sensor_as_identified(sensor: Sensor, identity: Identity) -> Sensor:
    """Return a sensor with the ADC and supply that the camera reports.

    Raises UserError if no SPADCAM has these values, or the sensor does not allow them.
    """
    for name, (least, most) in _POSSIBLE.items():
        if not least <= (value := getattr(identity, name)) <= most:
            raise UserError(
                f"the camera reports {name} {value}, but SPADCAM has {least} to {most}; flash this "
                "release's firmware"
            )
    adc = {"adc_bits": identity.adc_bits, "supply_v": identity.supply_mv * 1e-3}
    with refused_as(f"sensor {sensor.name}: does not fit the camera"):
        return changed(sensor, counter=adc)


@dataclass(frozen=True)
class CaptureSettings:
    """Settings of a recording."""

    sensor: Sensor
    """Nominal sensor, whose step gives the counts."""
    kind: str
    """Kind of recording, such as "dark" or "flat"; stored with it."""
    exposure_s: float
    frame_rate_hz: float
    step_bias: int
    row_window: tuple[int, int]
    """First row that is read, and the row after the last."""
    frames: int | None = None
    """Number of frames; default: until stopped."""
    seconds: float | None = None
    """Duration, from the first frame on."""

    def check(self) -> None:
        """Check that the camera supports the settings. Raises UserError."""
        check_kind(self.kind)
        for name, limit in (("frames", self.frames), ("seconds", self.seconds)):
            if limit is not None and not 0 < limit < math.inf:
                raise UserError(f"--{name}: {quoted(limit)}; give more than 0, or omit it")
        for name, value, least in (
            ("exposure", self.exposure_s, 1e-6),
            ("rate", self.frame_rate_hz, 1e-3),
        ):
            if not least <= value <= 4000:
                raise UserError(f"--{name}: {value:g}; give a value between {least:g} and 4000")
        if self.exposure_us > self.wanted().period_us:
            raise UserError(
                f"--exposure: {self.exposure_s:g} s is longer than a frame at --rate "
                f"{self.frame_rate_hz:g}; lower the rate to {1 / self.exposure_s:g} or less"
            )
        if not self.wanted().are_possible:
            first, end = self.row_window
            raise UserError(
                f"--step-bias {self.step_bias}, --rows {first} {end}: give a bias of 0 to "
                "4095, and rows 0 <= first < end <= 16"
            )

    @property
    def exposure_us(self) -> int:
        """Exposure, µs."""
        return round(self.exposure_s * 1e6)

    def wanted(self) -> Settings:
        """Settings in the camera's format."""
        rate_mhz = round(self.frame_rate_hz * 1e3)
        return Settings(self.exposure_us, rate_mhz, self.step_bias, *self.row_window)
