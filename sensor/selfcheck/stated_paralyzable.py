"""Stated moments of paralyzable dead time, with and without a gate, against sums over short steps.

Counts come at ν(t) = r·exp(−r·(O(t) − O(t−τ))) while the gate is open, O being the time that it has
been open. Counts at t and t' are independent where τ or more lies between, and exclude each other
where less does:

    E[N] = ∫ ν dt          Var[N] = E[N] − 2·∫ ν(t)·(∫ ν(t') dt' over the τ before t) dt
"""

from collections.abc import Iterator
from itertools import product

import numpy as np

from megalopta.sensor import changed
from megalopta.sensor.effects import DeadTime, Gate
from megalopta.sensor.selfcheck.comparison import Row, exact_row
from megalopta.sensor.spad import event_moments, preset

_STEPS_OF_MS = 500
# period, width, phase, dead time, exposure, ms: closed for longer and for less than a dead time,
# several periods to one, no gate; the exposure ends in an open window and outside
_CASES = (
    (17, 11, 4, 5, 97),
    (17, 11, 4, 5, 100),
    (17, 14, 15, 7, 60),
    (3, 2, 1, 8, 70),
    (0, 0, 0, 3, 40),
)


def check_stated_paralyzable() -> Iterator[Row]:
    """Live at the start and after long running."""
    for case, rate, start in product(_CASES, (60.0, 400.0), ("live", "stationary")):
        period, width, phase, dead, exposure = case
        sensor = changed(
            preset("ideal"),
            exposure_s=exposure * 1e-3,
            gate=_gate(period, width, phase),
            dead_time=DeadTime.model_validate(
                {"kind": "paralyzable", "dead_time_s": dead * 1e-3, "start": start}
            ),
        )
        expected = _sums(rate * 1e-3, *case, start)
        found = event_moments(np.full((1, 1, 1), rate), sensor)
        term = f"paralyzable, gate {width} of {period} ms" if period else "paralyzable, no gate"
        for name, right, got in zip(("mean", "variance"), expected, found, strict=True):
            quantity = f"{name}, τ {dead} of {exposure} ms, {rate:g} Hz, {start}"
            yield exact_row(term, quantity, right, got.item(), 1e-6 * right)


def _gate(period: int, width: int, phase: int) -> Gate:
    if not period:
        return Gate()
    return Gate(period_s=period * 1e-3, width_s=width * 1e-3, phase_s=phase * 1e-3)


def _sums(
    rate: float, period: int, width: int, phase: int, dead: int, exposure: int, start: str
) -> tuple[float, float]:
    """Mean and variance; the rate per ms, times in ms, by the middles of steps."""
    step, lag = 1 / _STEPS_OF_MS, dead * _STEPS_OF_MS
    times = (np.arange(-2 * lag, exposure * _STEPS_OF_MS) + 0.5) * step
    is_open = (times - phase) % period < width if period else np.ones(times.size, np.bool_)
    if start == "live":
        is_open &= times > 0
    opened = np.cumsum(is_open) * step - is_open * step / 2
    counted = rate * is_open[lag:] * np.exp(-rate * (opened[lag:] - opened[:-lag]))
    counted[:lag] = 0.0  # before the exposure
    total = np.cumsum(counted) * step - counted * step / 2
    mean = float(counted.sum() * step)
    return mean, mean - 2 * float((counted[lag:] * (total[lag:] - total[:-lag])).sum() * step)
