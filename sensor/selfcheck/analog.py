"""Output of the analog counter, in volts, step after step and term by term."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor import changed
from megalopta.sensor.counters import (
    AnalogCounter,
    AnalogPixels,
    analog_pixels,
    counter_moments,
    counts_of_codes,
    read_analog,
    sample_analog,
)
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck.comparison import Row, exact_row, mean_row, variance_row

_EXPOSURE_S, _SIDE, _EVENTS = 0.1, 200, 100
_COUNTER = AnalogCounter(step_v=10e-3, swing_v=3.2, supply_v=3.3, adc_bits=16)
_LSB_V = 3.3 / (2**16 - 1)


def check_analog() -> Iterator[Row]:
    """Steps that shrink, leak, and the variance that each scatter makes alone."""
    term = "analog counter, output"
    for slope in (-0.4, 0.0, 0.4):
        counter = changed(_COUNTER, step_slope=slope, leak_v_s=2.0)
        expected, fallen = [], 0.0
        for _ in range(250):
            expected.append(3.3 - min(fallen + 2.0 * _EXPOSURE_S, 3.2))
            fallen += 10e-3 * (1 + slope * (0.5 - fallen / 3.2))
        off = _volts(counter, np.arange(250)[None]) - expected
        yield exact_row(
            term, f"largest error, slope {slope:g} (V)", 0.0, float(np.abs(off).max()), _LSB_V
        )
    scatters: tuple[tuple[str, dict[str, float], float], ...] = (
        ("read noise", {"read_noise_v": 5e-3}, 5e-3**2),
        ("noise of steps", {"step_noise_v": 1e-3}, _EVENTS * 1e-3**2),
        ("steps of pixels", {"step_sigma_v": 1e-4}, (_EVENTS * 1e-4) ** 2),
        ("offsets", {"offset_sigma_v": 20e-3}, 20e-3**2),
        ("leaks", {"leak_v_s": 2.0, "leak_sigma_v_s": 0.1}, (0.1 * _EXPOSURE_S) ** 2),
    )
    for name, changes, variance in scatters:
        counter = changed(_COUNTER, **changes)
        volts = _volts(counter, np.full((_SIDE, _SIDE), _EVENTS))
        mean = 3.3 - _EVENTS * 10e-3 - changes.get("leak_v_s", 0.0) * _EXPOSURE_S
        yield mean_row(term, f"mean, {name} (V)", mean, volts)
        rounding = _LSB_V**2 / 12
        yield variance_row(term, f"variance, {name} (V²)", variance + rounding, volts)


def check_codes() -> Iterator[Row]:
    """Codes of uneven pixels, free of noise, turned back by what the pixels are known to be."""
    term = "analog counter, codes"
    counter = changed(
        _COUNTER, step_sigma_v=2e-4, leak_v_s=2.0, leak_sigma_v_s=0.1, offset_sigma_v=20e-3
    )
    events = generator(5).integers(0, 400, (_SIDE, _SIDE))
    pixels = analog_pixels(counter, events.shape, _EXPOSURE_S, 3)
    codes = sample_analog(generator(9), events, counter, pixels)
    counts, is_full = counts_of_codes(codes, counter, pixels)
    capacity = np.floor((3.2 - pixels.leaked_v) / pixels.step_v)
    wrong = float((counts != np.minimum(events, capacity)).mean())
    yield exact_row(term, "share misread", 0.0, wrong, 1e-9)
    full = float((events >= capacity).mean())
    yield exact_row(term, "share full", full, float(is_full.mean()), 1e-9)


def check_silent_readings() -> Iterator[Row]:
    """Readings without noise, as drawn and as stated: outputs beyond both ends of a coarse ADC."""
    uneven = changed(
        AnalogCounter(step_v=0.1, swing_v=3.3, supply_v=3.3, adc_bits=6),
        **{"step_sigma_v": 5e-3, "leak_v_s": 1.0, "leak_sigma_v_s": 0.1, "offset_sigma_v": 0.2},
    )
    events = generator(6).integers(0, 60, (_SIDE, _SIDE))
    for name, counter in (
        ("calibrated", uneven),
        ("calibrated, shrinking steps", changed(uneven, step_slope=0.5)),
        ("uncalibrated", changed(uneven, calibrated=False)),
        ("no ADC", changed(uneven, adc_bits=None)),
    ):
        pixels = analog_pixels(counter, events.shape, _EXPOSURE_S, 3)
        counts, _ = read_analog(generator(9), events, counter, pixels, _EXPOSURE_S)
        flat = AnalogPixels(*(each.ravel() for each in pixels))
        first, certain = events.ravel().astype(np.float64), np.ones((events.size, 1))
        mean, variance = counter_moments(counter, flat, _EXPOSURE_S, first, certain)
        off = float(np.abs(mean - counts.ravel()).max())
        term = f"analog counter, {name}"
        yield exact_row(term, "largest error of a reading without noise", 0.0, off, 1e-9)
        largest = float(variance.max())
        yield exact_row(term, "its largest variance", 0.0, largest, 1e-9)


def _volts(counter: AnalogCounter, events: NDArray[np.integer[Any]]) -> Floats:
    pixels = analog_pixels(counter, events.shape, _EXPOSURE_S, 3)
    codes = sample_analog(generator(9), events.astype(np.int64), counter, pixels)
    return np.asarray(codes * _LSB_V)
