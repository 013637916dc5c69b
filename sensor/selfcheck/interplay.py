"""Mean and variance of readings, stated against drawn: every effect on avalanches and its partners.

Many small frames in even light. With crosstalk the pixels of a frame go together, so that frames
are what is independent.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor import changed
from megalopta.sensor.avalanches import MEAN_ERROR, VARIANCE_ERROR
from megalopta.sensor.effects import Afterpulsing, Crosstalk, DarkCounts, DeadTime, Gate, Jitter
from megalopta.sensor.selfcheck.comparison import LARGEST_Z, Check, Row
from megalopta.sensor.spad import Sensor, expose_rate, preset, reading_moments

_Effects = dict[str, Any]

_SIDE = 10
_ARRIVALS = 12.0
_TAU_S = 5e-3
_TABLE_MEAN, _TABLE_VARIANCE = 3e-3, 1.5e-2
"""Standard errors of moments that are simulated, as `avalanches` states them"""

_ACTIVE: _Effects = {"dead_time": DeadTime(kind="nonparalyzable", dead_time_s=_TAU_S)}
_PASSIVE: _Effects = {"dead_time": DeadTime(kind="paralyzable", dead_time_s=_TAU_S)}
_TWILIGHT: _Effects = {"dead_time": changed(_ACTIVE["dead_time"], twilight_s=_TAU_S / 4)}
_RECHARGING: _Effects = {"dead_time": changed(_ACTIVE["dead_time"], recharge_s=_TAU_S / 2)}
_TRAPS: _Effects = {"afterpulsing": Afterpulsing(mean_carriers=0.3, delay_s=_TAU_S)}
_TABLE: _Effects = {
    "afterpulsing": Afterpulsing(
        mean_carriers=0.3, table_delays_s=(0, 5e-3, 15e-3), table_cumulative=(0, 0.6, 1)
    )
}
_TALK: _Effects = {"crosstalk": Crosstalk(mean_fired_neighbors=0.3, diagonal=0.3, distance_two=0.1)}
_GATE: _Effects = {"gate": Gate(period_s=17e-3, width_s=11e-3, phase_s=4e-3)}

_CASES: dict[str, _Effects] = {
    "dark counts": {"dark_counts": DarkCounts(bulk_mean_hz_um2=0.5)},
    "jitter": {"jitter": Jitter(sigma_s=1e-9)},
    "gate": _GATE,
    "afterpulsing": _TRAPS,
    "afterpulsing, table": _TABLE,
    "crosstalk": _TALK,
    "crosstalk, afterpulsing": _TALK | _TRAPS,
    "crosstalk, gate": _TALK | _GATE,
    "afterpulsing, gate": _TRAPS | _GATE,
    "crosstalk, afterpulsing, gate": _TALK | _TRAPS | _GATE,
    **{
        f"{name} dead time{extra}": dead | more
        for name, dead in (("non-paralyzable", _ACTIVE), ("paralyzable", _PASSIVE))
        for extra, more in (
            ("", {}),
            (", afterpulsing", _TRAPS),
            (", gate", _GATE),
            (", crosstalk", _TALK),
            (", crosstalk, afterpulsing", _TALK | _TRAPS),
            (", afterpulsing, gate", _TRAPS | _GATE),
        )
    },
    **{
        f"{name}{extra}": dead | more
        for name, dead in (("twilight", _TWILIGHT), ("recharging", _RECHARGING))
        for extra, more in (("", {}), (", crosstalk, afterpulsing", _TALK | _TRAPS))
    },
    **{
        f"{name} dead time, running": {"dead_time": changed(dead["dead_time"], start="stationary")}
        for name, dead in (("non-paralyzable", _ACTIVE), ("paralyzable", _PASSIVE))
    },
}


def interplay_checks(exposures: int = 40_000) -> tuple[Check, ...]:
    """Return a check for every effect on avalanches, and those that act on each other."""
    return tuple(
        partial(_rows, f"reading, {name}", changed(preset("ideal"), **effects), exposures)
        for name, effects in _CASES.items()
    )


def _rows(name: str, sensor: Sensor, exposures: int) -> Iterator[Row]:
    frames = exposures // _SIDE**2
    rate = np.full((frames, _SIDE, _SIDE), _ARRIVALS / sensor.exposure_s)
    drawn = expose_rate(rate, sensor, seed=4, sequence=name).counts.astype(np.float64)
    mean, variance = reading_moments(rate[:1], sensor)
    errors = _stated_errors(sensor)
    deviation = drawn - mean
    for quantity, expected, found, error in (
        (f"mean reading ({sensor.unit})", mean, drawn, errors[0]),
        (f"variance of the reading ({sensor.unit}²)", variance, deviation**2, errors[1]),
    ):
        yield _row(name, quantity, float(expected.mean()), found.mean((1, 2)), error)


def _row(name: str, quantity: str, expected: float, frames: Floats, error: float) -> Row:
    chance = frames.std() / frames.size**0.5
    z = (frames.mean() - expected) / np.hypot(chance, error * expected)
    return Row(name, quantity, expected, float(frames.mean()), float(z))


def _stated_errors(sensor: Sensor) -> tuple[float, float]:
    """Relative errors of mean and variance; bounds as five standard errors."""
    effects = sensor.avalanche_effects
    alone = effects.on - {"crosstalk"}
    has_law = effects.dead_time.has_law and (
        (alone == {"afterpulsing"} and not effects.afterpulsing.table_delays_s)
        or alone <= {"gate"}
        or alone == {"dead_time"}
        or (alone == {"gate", "dead_time"} and effects.dead_time.kind == "paralyzable")
    )
    fired = effects.crosstalk.mean_fired_neighbors * bool(alone - {"gate"}) / LARGEST_Z
    return (
        float(np.hypot(MEAN_ERROR * fired, _TABLE_MEAN * (not has_law))),
        float(np.hypot(VARIANCE_ERROR * fired, _TABLE_VARIANCE * (not has_law))),
    )
