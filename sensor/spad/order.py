"""The effects of a sensor in the order in which they act: one list, for readers and programs.

There are rates of arrivals as far as "temperature", avalanches up to "jitter", and a number in a
counter after that. The effects on avalanches act on each other in time and are simulated together
wherever more than one is on.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from megalopta.sensor import changed
from megalopta.sensor.counters import LARGEST_CAPACITY, AnalogCounter, DigitalCounter
from megalopta.sensor.effects import (
    Afterpulsing,
    Bias,
    Crosstalk,
    DarkCounts,
    DeadTime,
    Gate,
    Jitter,
    Temperature,
    mean_density,
)
from megalopta.sensor.optics import Efficiency, Lens
from megalopta.sensor.spad.measured import MeasuredMaps
from megalopta.sensor.spad.model import Sensor


@dataclass(frozen=True)
class Effect:
    """One effect.

    Attributes
    ----------
    field : str
        Field of `Sensor` that holds its parameters.
    statement : str
        What it does, for a reader.
    is_on : callable
        Whether it does something in a given sensor.
    off : callable
        Changes to a given sensor with which it does nothing (the lens: a perfect one).
    """

    field: str
    statement: str
    is_on: Callable[[Sensor], bool]
    off: Callable[[Sensor], dict[str, Any]]


def _efficiency_off(sensor: Sensor) -> dict[str, Any]:
    bias = sensor.bias
    has_other = bias.dark_efold_v is not None or bias.onset_v > 0
    return {
        "efficiency": Efficiency(wavelengths_nm=(1.0, 1e6), values=(1.0, 1.0)),
        "bias": {"efficiency_scale_v": None} if has_other else Bias(),
        "measured": {"efficiency": None},
    }


ORDER_OF_EFFECTS: tuple[Effect, ...] = (
    Effect(
        "lens",
        "radiance becomes photons per second on the pixel",
        lambda _: True,
        lambda _: {"lens": Lens()},
    ),
    Effect(
        "efficiency",
        "a fraction of the photons on the active area, by wavelength, starts an avalanche",
        lambda s: min(s.efficiency.values) < 1 or s.measured.efficiency is not None,
        _efficiency_off,
    ),
    Effect(
        "dark_counts",
        "carriers that are no photons' arrive too, in every pixel at a rate of its own",
        lambda s: mean_density(s.dark_counts) > 0 or s.measured.dark_counts is not None,
        lambda _: {"dark_counts": DarkCounts(), "measured": {"dark_counts": None}},
    ),
    Effect(
        "measured",
        "measured maps replace drawn patterns of efficiency, dark counts and breakdown",
        lambda s: s.measured.has_any,
        lambda _: {"measured": MeasuredMaps()},
    ),
    Effect(
        "bias",
        "excess bias and its mismatch scale efficiency and dark counts of each pixel",
        lambda s: s.bias.is_on or s.measured.breakdown is not None,
        lambda _: {"bias": Bias(), "measured": {"breakdown": None}},
    ),
    Effect(
        "temperature",
        "temperature scales the dark counts",
        lambda s: s.temperature.celsius != s.temperature.reference_celsius,
        lambda _: {"temperature": Temperature()},
    ),
    Effect(
        "gate",
        "what arrives outside the window is lost",
        lambda s: s.gate.is_on,
        lambda _: {"gate": Gate()},
    ),
    Effect(
        "dead_time",
        "what arrives while the pixel recovers is lost",
        lambda s: s.dead_time.kind != "ideal",
        lambda _: {"dead_time": DeadTime()},
    ),
    Effect(
        "afterpulsing",
        "avalanches fill traps whose carriers arrive later",
        lambda s: s.afterpulsing.is_on,
        lambda _: {"afterpulsing": Afterpulsing()},
    ),
    Effect(
        "crosstalk",
        "avalanches send light to neighboring pixels",
        lambda s: s.crosstalk.is_on,
        lambda _: {"crosstalk": Crosstalk()},
    ),
    Effect(
        "jitter",
        "time stamps of events scatter (event streams only)",
        lambda s: s.jitter.is_on,
        lambda _: {"jitter": Jitter()},
    ),
    Effect(
        "counter",
        "avalanches are counted, as far as the counter goes, and read (frames only)",
        lambda s: isinstance(s.counter, AnalogCounter) or s.counter.capacity < LARGEST_CAPACITY,
        lambda _: {"counter": DigitalCounter()},
    ),
)
"""First to last."""


def without(sensor: Sensor, field: str) -> Sensor:
    """Return the sensor with one effect switched off.

    Without "efficiency", every photon on the active area is detected, wherever a pixel's bias is
    above the onset. Without "dark_counts", measured ones are off too.

    Raises
    ------
    ValueError
        When there is no effect of this name.
    """
    for effect in ORDER_OF_EFFECTS:
        if effect.field == field:
            return changed(sensor, **effect.off(sensor))
    known = ", ".join(effect.field for effect in ORDER_OF_EFFECTS)
    raise ValueError(f"effect {field!r}: no such effect; choose from {known}")


def active_effects(sensor: Sensor) -> tuple[str, ...]:
    """Names of the effects that are on, in order."""
    return tuple(effect.field for effect in ORDER_OF_EFFECTS if effect.is_on(sensor))
