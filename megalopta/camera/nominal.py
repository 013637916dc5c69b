"""The sensor that a camera is said to be: by name, with its settings, with its ADC."""

from megalopta.core.errors import UserError
from megalopta.sensor import AnalogCounter, Sensor, changed, load_sensor, preset
from megalopta.sensor.spadcam.messages import (
    COLUMNS,
    NOMINAL_STEP_BIAS,
    ROWS,
    Identity,
    Settings,
)

_POSSIBLE = {
    "rows": (ROWS, ROWS),
    "columns": (COLUMNS, COLUMNS),
    "adc_bits": (1, 16),
    "supply_mv": (1000, 6000),
}
"""What a camera can say of itself."""


def named_sensor(name: str) -> Sensor:
    """Return a preset, or the sensor of a YAML file. Raises UserError."""
    try:
        return load_sensor(name) if name.endswith((".yaml", ".yml")) else preset(name)
    except ValueError as problem:
        raise UserError(f"--sensor: {problem}") from None


def sensor_as_set(sensor: Sensor, settings: Settings) -> Sensor:
    """A sensor with the camera's exposure, and its step in proportion to the bias (assumed).

    Raises
    ------
    UserError
        When the sensor cannot be so, or its counters are not read by an ADC.
    """
    counter = sensor.counter
    if not isinstance(counter, AnalogCounter) or not 0 < (counter.adc_bits or 0) <= 16:
        raise UserError(
            f"sensor {sensor.name}: its counters are not read by an ADC of 1 to 16 bits; "
            "choose another, such as spadcam"
        )
    step_v = counter.step_v * settings.step_bias / NOMINAL_STEP_BIAS
    try:
        return changed(sensor, exposure_s=settings.exposure_us / 1e6, counter={"step_v": step_v})
    except ValueError as problem:
        raise UserError(f"sensor {sensor.name}: {problem}") from None


def sensor_as_identified(sensor: Sensor, identity: Identity) -> Sensor:
    """A sensor with the ADC and supply that the camera says it has.

    Raises
    ------
    UserError
        When the camera says what no SPADCAM has, or the sensor cannot have it.
    """
    for name, (least, most) in _POSSIBLE.items():
        if not least <= (value := getattr(identity, name)) <= most:
            raise UserError(
                f"the camera says {name} {value}, a SPADCAM has {least} to {most}; flash this "
                "release's firmware"
            )
    adc = {"adc_bits": identity.adc_bits, "supply_v": identity.supply_mv * 1e-3}
    try:
        return changed(sensor, counter=adc)
    except ValueError as problem:
        raise UserError(f"sensor {sensor.name}: does not fit the camera: {problem}") from None
