"""The effects of a sensor in the order in which they act: one list, for readers and programs.

Light is an array of rates as far as "dark counts", a set of avalanches up to "jitter", and a number
in a counter after that. The effects on avalanches act on each other in time and are simulated
together wherever more than one is on.
"""

from collections.abc import Callable
from dataclasses import dataclass

from pydantic import BaseModel

from megalopta.sensor.afterpulsing import Afterpulsing
from megalopta.sensor.analog_counter import AnalogCounter
from megalopta.sensor.bias import Bias
from megalopta.sensor.counter import LARGEST_CAPACITY, DigitalCounter
from megalopta.sensor.crosstalk import Crosstalk
from megalopta.sensor.dark_counts import DarkCounts, mean_density
from megalopta.sensor.dead_time import DeadTime
from megalopta.sensor.efficiency import Efficiency
from megalopta.sensor.gating import Gate
from megalopta.sensor.jitter import Jitter
from megalopta.sensor.measured import MeasuredMaps
from megalopta.sensor.model import Sensor
from megalopta.sensor.optics import Lens
from megalopta.sensor.temperature import Temperature


@dataclass(frozen=True)
class Effect:
    """One effect.

    Attributes
    ----------
    field : str
        Field of `Sensor` that holds its parameters.
    statement : str
        What it does, for a reader.
    off : BaseModel
        Parameters with which it does nothing (the lens: a perfect one without falloff).
    is_on : callable
        Whether it does something in a given sensor.
    """

    field: str
    statement: str
    off: BaseModel
    is_on: Callable[[Sensor], bool]


ORDER_OF_EFFECTS: tuple[Effect, ...] = (
    Effect(
        "lens",
        "radiance becomes photons per second on the pixel",
        Lens(),
        lambda _: True,
    ),
    Effect(
        "efficiency",
        "a fraction of the photons on the active area, by wavelength, starts an avalanche",
        Efficiency(wavelengths_nm=(1.0, 1e6), values=(1.0, 1.0)),
        lambda sensor: min(sensor.efficiency.values) < 1,
    ),
    Effect(
        "bias",
        "excess bias and its mismatch scale efficiency and dark counts of each pixel",
        Bias(),
        lambda sensor: sensor.bias != Bias(),
    ),
    Effect(
        "temperature",
        "temperature scales the dark counts",
        Temperature(),
        lambda sensor: sensor.temperature.celsius != sensor.temperature.reference_celsius,
    ),
    Effect(
        "measured",
        "measured maps replace drawn patterns of efficiency, dark counts and breakdown",
        MeasuredMaps(),
        lambda sensor: sensor.measured != MeasuredMaps(),
    ),
    Effect(
        "dark_counts",
        "carriers that are no photons' join the photons that would be detected",
        DarkCounts(),
        lambda sensor: mean_density(sensor.dark_counts) > 0,
    ),
    Effect(
        "gate",
        "what arrives outside the window is lost",
        Gate(),
        lambda sensor: sensor.gate.is_on,
    ),
    Effect(
        "dead_time",
        "what arrives while the pixel recovers is lost",
        DeadTime(),
        lambda sensor: sensor.dead_time.kind != "ideal",
    ),
    Effect(
        "afterpulsing",
        "avalanches fill traps whose carriers arrive later",
        Afterpulsing(),
        lambda sensor: sensor.afterpulsing.is_on,
    ),
    Effect(
        "crosstalk",
        "avalanches send light to neighboring pixels",
        Crosstalk(),
        lambda sensor: sensor.crosstalk.is_on,
    ),
    Effect(
        "jitter",
        "time stamps of events scatter (event streams only)",
        Jitter(),
        lambda sensor: sensor.jitter.is_on,
    ),
    Effect(
        "counter",
        "avalanches are counted, as far as the counter goes, and read (frames only)",
        DigitalCounter(),
        lambda sensor: (
            isinstance(sensor.counter, AnalogCounter) or sensor.counter.capacity < LARGEST_CAPACITY
        ),
    ),
)
"""First to last."""


def without(sensor: Sensor, field: str) -> Sensor:
    """Return the sensor with one effect switched off.

    Raises
    ------
    ValueError
        When there is no effect of this name.
    """
    for effect in ORDER_OF_EFFECTS:
        if effect.field == field:
            return sensor.model_copy(update={field: effect.off})
    known = ", ".join(effect.field for effect in ORDER_OF_EFFECTS)
    raise ValueError(f"effect {field!r}: no such effect; choose from {known}")


def describe(sensor: Sensor) -> list[str]:
    """One line per effect that is on, in order."""
    active = [effect for effect in ORDER_OF_EFFECTS if effect.is_on(sensor)]
    return [f"{effect.field}: {effect.statement}" for effect in active]
