"""Light given in parts of an exposure: closed forms, an integral, a balance, single photons.

With r(t) the rate of arrivals and ν(t) that of counts, live at the start and dark before it,

    paralyzable        ν(t) = r(t)·exp(−∫ r over the last τ): counted where none came within τ
    non-paralyzable    ν(t) = r(t)·(1 − ∫ ν over the last τ): each count blinds for τ

are exact for any light. Each is summed over steps of τ/200.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor import changed
from megalopta.sensor.effects import DeadTime
from megalopta.sensor.readout import expose_binary, expose_events, unpack
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck.brute_force import brute_force_frames
from megalopta.sensor.selfcheck.comparison import (
    Counts,
    Row,
    exact_row,
    mean_row,
    variance_row,
    worst,
    z_rows,
)
from megalopta.sensor.selfcheck.counting import GATE
from megalopta.sensor.spad import Sensor, event_moments, expose_rate, preset

_TAU_S, _EXPOSURE_S = 1e-6, 20e-6
_SPLITS = (2, 5, 16)
_FRAMES, _SIDE = 2, 100
_STEPS_OF_TAU = 200
# 3 of every 7 µs are open from 5 µs on, as written down in `GATE`
_OPEN_US = ((0, 1), (5, 8), (12, 15), (19, 20))


def check_parts() -> Iterator[Row]:
    """Counts, bits and events of Poisson light, through a gate and with dead time."""
    for parts in _SPLITS:
        light_hz = _light(parts)
        yield from _poisson_rows(light_hz)
        for kind, exact in (
            ("paralyzable", _paralyzable_mean(light_hz)),
            ("nonparalyzable", _nonparalyzable_mean(light_hz)),
        ):
            dead = DeadTime.model_validate({"kind": kind, "dead_time_s": _TAU_S})
            yield from _dead_time_rows(f"{kind} dead time, {parts} parts", light_hz, dead, exact)


def _poisson_rows(light_hz: Floats) -> Iterator[Row]:
    parts, sensor = light_hz.size, _sensor()
    term, part_s = f"light in {parts} parts", _EXPOSURE_S / light_hz.size
    total = float(light_hz.sum() * part_s)
    counts, (mean, _) = _drawn(light_hz, sensor, term)
    yield mean_row(term, "counts", total, counts)
    yield variance_row(term, "variance of counts", total, counts)
    yield exact_row(term, "stated mean", total, mean, 1e-9 * total)
    edges = np.linspace(0, _EXPOSURE_S, parts + 1)
    opened = [
        sum(max(min(end, 1e-6 * last) - max(start, 1e-6 * first), 0.0) for first, last in _OPEN_US)
        for start, end in pairwise(edges)
    ]
    gated_total = float((light_hz * opened).sum())
    gated = changed(sensor, gate=GATE)
    counts, (mean, _) = _drawn(light_hz, gated, f"{term}, gate")
    yield mean_row(f"{term}, gate", "counts", gated_total, counts)
    yield exact_row(f"{term}, gate", "stated mean", gated_total, mean, 1e-9 * gated_total)
    dim = _everywhere(light_hz / 40)
    bits = unpack(expose_binary(dim, gated, seed=7, sequence=term), _SIDE)
    chance = -np.expm1(-gated_total / 40)
    yield mean_row(
        f"{term}, gate", "part of ones in binary frames", chance, bits.astype(np.float64)
    )
    stream = expose_events(_everywhere(light_hz), sensor, seed=7, sequence=term)
    found = np.histogram(stream.time_s, edges)[0]
    expected = light_hz * part_s * _FRAMES * _SIDE**2
    yield worst(
        [
            Row(
                term,
                f"events (worst part, {part})",
                due,
                float(number),
                float((number - due) / max(due, 1e-9) ** 0.5),
            )
            for part, (due, number) in enumerate(zip(expected, found, strict=True))
        ]
    )


def _dead_time_rows(term: str, light_hz: Floats, dead: DeadTime, exact: float) -> Iterator[Row]:
    sensor = changed(_sensor(), dead_time=dead)
    counts, (mean, _) = _drawn(light_hz, sensor, term)
    yield mean_row(term, "counts", exact, counts)
    # `PARTS_ERROR`
    bound = light_hz.size * -np.expm1(-light_hz.max() * _TAU_S)
    yield exact_row(term, "stated mean, within its bound", exact, mean, float(bound))
    plain = brute_force_frames(
        generator(41, term), light_hz[:, None, None], _EXPOSURE_S, sensor.avalanche_effects, 40_000
    )
    yield from z_rows(term, plain.ravel(), counts.ravel())


def _drawn(light_hz: Floats, sensor: Sensor, term: str) -> tuple[Counts, tuple[float, float]]:
    """Counts of many pixels, and the stated mean and variance of one."""
    rate = _everywhere(light_hz)
    counts = expose_rate(rate, sensor, seed=6, sequence=term).counts
    mean, variance = event_moments(rate[:1, :, :1, :1], sensor)
    return counts.astype(np.int64), (float(mean.item()), float(variance.item()))


def _everywhere(light_hz: Floats) -> Floats:
    shape = _FRAMES, light_hz.size, _SIDE, _SIDE
    return np.broadcast_to(light_hz[:, None, None], shape).copy()


def _sensor() -> Sensor:
    return changed(preset("ideal"), exposure_s=_EXPOSURE_S)


def _light(parts: int) -> Floats:
    """Rate of each part, Hz: brightest in the second, none in the last of many."""
    levels = np.array([0.3, 2.5, 0.8, 1.6, 0.1])[np.arange(parts) % 5]
    levels[5:] /= 2
    levels[15:] = 0
    return 1e6 * levels


def _rates_in_time(light_hz: Floats) -> tuple[Floats, float]:
    """Rate in the middle of every step, and the step, s."""
    step_s = _TAU_S / _STEPS_OF_TAU
    middles = (np.arange(round(_EXPOSURE_S / step_s)) + 0.5) * step_s
    return light_hz[(middles / _EXPOSURE_S * light_hz.size).astype(int)], step_s


def _paralyzable_mean(light_hz: Floats) -> float:
    rates, step_s = _rates_in_time(light_hz)
    arrived = np.cumsum(rates) * step_s - rates * step_s / 2
    before = np.concatenate([np.zeros(_STEPS_OF_TAU), arrived[:-_STEPS_OF_TAU]])
    return float((rates * np.exp(before - arrived)).sum() * step_s)


def _nonparalyzable_mean(light_hz: Floats) -> float:
    rates, step_s = _rates_in_time(light_hz)
    counted = np.zeros(rates.size)
    recent = 0.0  # counts within the last dead time, up to the step
    for step, rate in enumerate(rates):
        gone = counted[step - _STEPS_OF_TAU] if step >= _STEPS_OF_TAU else 0.0
        recent -= gone / 2  # the oldest and the newest step count by half
        counted[step] = rate * step_s * (1 - recent) / (1 + rate * step_s / 2)
        recent += counted[step] - gone / 2
    return float(counted.sum())
