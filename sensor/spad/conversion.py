"""Events to volts and back to counts, drawn."""

import numpy as np
from numpy.typing import NDArray

from megalopta.core.compiling import compiled
from megalopta.sensor.spad.analog import AnalogCounter, AnalogPixels, assumed_pixels


def read_analog(
    rng: np.random.Generator,
    events: NDArray[np.int64],
    counter: AnalogCounter,
    pixels: AnalogPixels,
    exposure_s: float,
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Counts, and where they are a lower bound, of a (rows, columns) frame of events."""
    known = assumed_pixels(counter, pixels, exposure_s)
    counts = np.empty(events.shape, np.int64)
    saturated = np.empty(events.shape, np.bool_)
    _read(rng, events, pixels, known, voltages(counter), counts, saturated)
    return counts, saturated


def sample_analog(
    rng: np.random.Generator,
    events: NDArray[np.int64],
    counter: AnalogCounter,
    pixels: AnalogPixels,
) -> NDArray[np.uint16]:
    """Codes of the ADC of a (rows, columns) frame of events; draws what `read_analog` draws.

    Raises
    ------
    ValueError
        When the counter has no ADC, or one of more than 16 bits.
    """
    if counter.adc_bits is None or counter.adc_bits > 16:
        raise ValueError(f"counter.adc_bits: {counter.adc_bits}; give 1 to 16 to sample its output")
    codes = np.empty(events.shape, np.uint16)
    _sample(rng, events, pixels, voltages(counter), codes)
    return codes


def counts_of_codes(
    codes: NDArray[np.uint16], counter: AnalogCounter, known: AnalogPixels
) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
    """Turn codes of the ADC (…, rows, columns) into counts, and where they are a lower bound.

    Parameters
    ----------
    codes : array
    counter : AnalogCounter
    known : AnalogPixels
        What is known of the pixels: measured, or `nominal_pixels`.
    """
    reference = counter.supply_v + known.offset_v - known.leaked_v
    counts = np.maximum(np.rint((reference - codes * counter.lsb_v) / known.step_v), 0)
    # As `largest_count`.
    capacity = np.floor((counter.swing_v - known.leaked_v) / known.step_v * (1 + 1e-9))
    return np.minimum(counts, capacity).astype(np.uint16), counts >= capacity


def voltages(counter: AnalogCounter) -> tuple[float, float, float, float, float, float]:
    """Supply, swing, slope of the step, its noise, read noise and one code, V but for the slope."""
    steps = counter.step_slope, counter.step_noise_v
    return counter.supply_v, counter.swing_v, *steps, counter.read_noise_v, counter.lsb_v


@compiled
def fall(events: float, step_v: float, slope: float, swing_v: float) -> float:
    """Mean fall of the output after so many events, V, as if it had no bottom."""
    change = slope * step_v / swing_v
    if change == 0:
        return events * step_v
    first_v = step_v * (1 + slope / 2)
    return float(-first_v / change * np.expm1(events * np.log1p(-change)))


@compiled
def spread(events: float, step_noise_v: float, step_v: float, swing_v: float) -> float:
    """Standard deviation of that fall, V; at twice the swing nothing is left to be taken off."""
    return float(step_noise_v * np.sqrt(min(events, 2 * swing_v / step_v)))


@compiled
def largest_count(step_v: float, leaked_v: float, swing_v: float) -> float:
    """Capacity of a pixel of which this is known."""
    return float(np.floor((swing_v - leaked_v) / step_v * (1 + 1e-9)))


@compiled
def _output(rng, events, step_v, leaked_v, offset_v, volts):  # type: ignore[no-untyped-def]
    """What is read of one pixel, V, and whether its counter is empty."""
    supply, swing, slope, step_noise, read_noise, lsb = volts
    fallen = fall(events, step_v, slope, swing) + leaked_v
    if step_noise > 0:
        fallen += spread(events, step_noise, step_v, swing) * rng.standard_normal()
    output = supply + offset_v - min(fallen, swing)
    if read_noise > 0:
        output += read_noise * rng.standard_normal()
    if lsb > 0:
        output = min(max(np.rint(output / lsb), 0.0), np.rint(supply / lsb)) * lsb
    return output, fallen > swing


@compiled
def _read(rng, events, pixels, known, volts, counts, saturated):  # type: ignore[no-untyped-def]
    supply, swing = volts[:2]
    for row in range(events.shape[0]):
        for column in range(events.shape[1]):
            at = row, column
            output, is_empty = _output(
                rng, events[at], pixels.step_v[at], pixels.leaked_v[at], pixels.offset_v[at], volts
            )
            step, leaked = known.step_v[at], known.leaked_v[at]
            reference = supply + known.offset_v[at] - leaked
            capacity = largest_count(step, leaked, swing)
            count = max(np.rint((reference - output) / step), 0.0)
            counts[at] = min(count, capacity)
            saturated[at] = is_empty or count >= capacity


@compiled
def _sample(rng, events, pixels, volts, codes):  # type: ignore[no-untyped-def]
    for row in range(events.shape[0]):
        for column in range(events.shape[1]):
            at = row, column
            output, _ = _output(
                rng, events[at], pixels.step_v[at], pixels.leaked_v[at], pixels.offset_v[at], volts
            )
            codes[at] = np.uint16(np.rint(output / volts[-1]))
