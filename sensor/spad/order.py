"""The effects of a sensor in the order in which they act.

There are rates of arrivals as far as "bias", avalanches up to "crosstalk", and a number in a
counter after that. The effects on avalanches act on each other in time and are simulated together
wherever more than one is on.
"""

from typing import Any, get_args

from megalopta.sensor.change import changed
from megalopta.sensor.effects.base import Effect
from megalopta.sensor.spad.measured import MeasuredMaps
from megalopta.sensor.spad.model import Sensor


def effects_of(model: type[Sensor]) -> tuple[str, ...]:
    """Return the fields of a model that hold effects, in the order in which these act."""
    stages = {
        name: kind.stage
        for name, field in model.model_fields.items()
        for kind in (get_args(field.annotation) or (field.annotation,))[:1]
        if isinstance(kind, type) and issubclass(kind, Effect)
    }
    return tuple(sorted(stages, key=lambda name: stages[name]))


ORDER_OF_EFFECTS = effects_of(Sensor)
"""Fields of `Sensor`, first to last."""


def without(sensor: Sensor, field: str) -> Sensor:
    """Return the sensor with one effect switched off.

    Without "efficiency", every photon on the active area is detected, wherever a pixel's bias is
    above the onset. Without "dark_counts", measured ones are off too.

    Raises
    ------
    ValueError
        When there is no effect of this name.
    """
    known = effects_of(type(sensor))
    if field not in known:
        raise ValueError(f"effect {field!r}: no such effect; choose from {', '.join(known)}")
    changes: dict[str, Any] = {field: getattr(sensor, field).off()}
    if field in MeasuredMaps.of_effect:
        changes["measured"] = {MeasuredMaps.of_effect[field]: None}
    if field in MeasuredMaps.relative:
        changes["measured"] = {field: None}
    if field == "efficiency":
        changes["bias"] = sensor.bias.without_efficiency()
    return changed(sensor, **changes)


def active_effects(sensor: Sensor) -> tuple[str, ...]:
    """Names of the effects that are on, in order."""
    measured = {
        name for name, file in MeasuredMaps.of_effect.items() if getattr(sensor.measured, file)
    }
    names = effects_of(type(sensor))
    return tuple(name for name in names if name in measured or getattr(sensor, name).is_on)
