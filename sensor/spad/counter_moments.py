"""Mean and variance of readings, from the moments or the distribution of event numbers.

Where all likely numbers of events fit into the counter and are read exactly, the reading has the
moments of the events; where none fits, those at saturation. Otherwise the distribution is used.

For N events, a digital counter reads min(N, C) or N mod (C + 1). An analog one reads j or more if
its output is below the upper edge of the last ADC code for j. With a normal drop F_N of the output
(step noise), clipped at the bottom S of the swing, and read noise r,

    P(count >= j | N) = P(min(F_N, S) − r > t_j)          t_j: that edge, from supply and offset

is an integral of the normal distribution, two-dimensional near the bottom, and the moments are sums
over j and N. The only approximation: a counter that misreads fewer than one in 10⁵ events is
treated as exact away from its ends, with an error of its variance below 1e-5 counts².
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy.special import ndtr

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.core.compiling import compiled
from megalopta.sensor.spad.counters import (
    AnalogCounter,
    AnalogPixels,
    DigitalCounter,
    assumed_pixels,
    fall,
    fall_deviation,
    largest_count,
    voltages,
)

_FEW_MISREAD = 1e-5
_FAR = 7.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)

Counter: TypeAlias = DigitalCounter | AnalogCounter


class CounterPixel(NamedTuple):
    """Step, leakage and offset, V; assumed step and output without events."""

    step_v: float
    leaked_v: float
    offset_v: float
    known_step_v: float
    reference_v: float
    capacity: float
    exact_below: float
    """Number of events below which they are read exactly"""


def events_until_full(counter: Counter, pixels: AnalogPixels | None) -> Floats:
    """Number of events above which readings are constant (rows, columns); infinite if wrapped."""
    if isinstance(counter, DigitalCounter):
        return np.array(np.inf if counter.overflow == "wrap" else counter.capacity)
    assert pixels is not None
    full = counter.swing_v / pixels.step_v
    # a slope of 1 takes 10 % more steps; their noise is below a ninth, taken nine times
    return np.asarray(np.ceil(1.2 * full + np.sqrt(1.2 * full) + 1))


def simple_moments(
    counter: Counter, pixels: AnalogPixels | None, moments: tuple[Floats, Floats], reach: Floats
) -> tuple[Floats, Floats, Mask]:
    """Mean and variance of readings without a distribution, and True where one is needed.

    `pixels`: pixels of an analog counter; `moments` (mean, variance): moments of the events, arrays
    of one shape; `reach` (2, ...): smallest and largest possible number of events.
    """
    (mean, variance), (least, most) = moments, reach
    if isinstance(counter, AnalogCounter):
        assert pixels is not None
        capacity = np.floor((counter.swing_v - pixels.leaked_v) / pixels.step_v)
        needs_law = np.full(mean.shape, misreads(counter, pixels)) | (most > capacity)
        return mean, variance, needs_law
    size = counter.capacity + 1
    if counter.overflow == "saturate":
        is_full = least >= counter.capacity
        needs_law = ~is_full & (most > counter.capacity)
        return np.where(is_full, counter.capacity, mean), np.where(is_full, 0, variance), needs_law
    # with so wide a distribution all remainders are equally likely, to 3e-9
    is_even = variance > size**2
    needs_law = ~is_even & (least // size != most // size)
    return (
        np.where(is_even, counter.capacity / 2, mean - least // size * size),
        np.where(is_even, (size**2 - 1) / 12, variance),
        needs_law,
    )


def counter_moments(
    counter: Counter,
    pixels: AnalogPixels | None,
    exposure_s: float,
    first: Floats,
    probability: Floats,
) -> tuple[Floats, Floats]:
    """Mean and variance of readings of pixels in a row, of any number.

    `pixels`: pixels of an analog counter, each (P,); `first` (P,): number of events of the first
    column of `probability`; `probability` (P, N): probabilities of that number of events and of the
    following ones.
    """
    if isinstance(counter, DigitalCounter):
        events = first[:, None] + np.arange(probability.shape[1])
        wraps = counter.overflow == "wrap"
        size = counter.capacity + 1
        counts = events % size if wraps else np.minimum(events, counter.capacity)
        mean = (probability * counts).sum(1)
        return mean, (probability * (counts - mean[:, None]) ** 2).sum(1)
    assert pixels is not None
    known = assumed_pixels(counter, pixels, exposure_s)
    mean, variance = np.empty(first.size), np.empty(first.size)
    is_exact = not misreads(counter, pixels)
    volts, first = voltages(counter), first.astype(np.float64)
    _integrate(first, probability, pixels, known, volts, is_exact, mean, variance)
    return mean, variance


def misreads(counter: AnalogCounter, pixels: AnalogPixels) -> bool:
    """True if events are misread even away from the ends of the counter."""
    is_clipped = counter.offset_sigma_v > 0 and counter.adc_bits is not None
    if not counter.calibrated or counter.step_slope or counter.step_noise_v or is_clipped:
        return True
    margin = (float(pixels.step_v.min(initial=counter.step_v)) - counter.lsb_v) / 2
    if counter.read_noise_v == 0:
        return margin <= 0
    return bool(2 * ndtr(-margin / counter.read_noise_v) > _FEW_MISREAD)


@compiled
def _integrate(first, probability, pixels, known, volts, is_exact, mean, variance):  # type: ignore[no-untyped-def]
    for at in range(first.size):
        pixel = _pixel_of(at, pixels, known, volts, is_exact)
        center = np.rint(first[at] + probability.shape[1] / 2)
        once = twice = 0.0
        is_full, full_mean, full_square = False, 0.0, 0.0
        for column in range(probability.shape[1]):
            weight, events = probability[at, column], first[at] + column
            if events < pixel.exact_below:
                once += weight * (events - center)
                twice += weight * (events - center) ** 2
                continue
            if not is_full:  # otherwise as with one event less
                full_mean, full_square, is_full = _read_of(events, center, pixel, volts)
            once += weight * (full_mean - center)
            twice += weight * full_square
        mean[at] = center + once
        variance[at] = max(twice - once**2, 0.0)


@compiled
def _pixel_of(at, pixels, known, volts, is_exact):  # type: ignore[no-untyped-def]
    """Values of one pixel, and the number of events below which it reads exactly."""
    supply, swing, read_noise = volts[0], volts[1], volts[4]
    leaked = pixels.leaked_v[at]
    capacity = largest_count(known.step_v[at], known.leaked_v[at], swing)
    exact_below = 0.0
    if is_exact:
        exact_swing = swing - leaked - _FAR * read_noise
        exact_below = min(capacity, exact_swing / pixels.step_v[at])
    reference = supply + known.offset_v[at] - known.leaked_v[at]
    return CounterPixel(
        pixels.step_v[at], leaked, pixels.offset_v[at],
        known.step_v[at], reference, capacity, exact_below,
    )  # fmt: skip


@compiled
def _read_of(events, center, pixel, volts):  # type: ignore[no-untyped-def]
    """Mean reading of a number of events, mean square about a center, and True if saturated."""
    supply, swing, slope, step_noise, read_noise, lsb = volts
    fallen = fall(events, pixel.step_v, slope, swing) + pixel.leaked_v
    scatter = fall_deviation(events, step_noise, pixel.step_v, swing)
    noise = np.hypot(scatter, read_noise)
    step, reference, capacity = pixel.known_step_v, pixel.reference_v, pixel.capacity
    reached = (min(fallen, swing) - pixel.offset_v + reference - supply) / step
    margin = (_FAR * noise + lsb) / step
    count = min(max(np.floor(reached - margin), 0.0), capacity)
    if lsb > 0:  # an output below ground is read as ground
        count = min(count, max(np.floor(reference / step + 0.5), 0.0))
    mean, square = count, (count - center) ** 2
    while count < capacity:
        edge, always, never = _edge(reference - (count + 0.5) * step, supply, lsb)
        chance = 1.0
        if never:
            chance = 0.0
        elif not always:
            depth = supply + pixel.offset_v - edge
            chance = _chance(fallen - depth, swing - depth, scatter, read_noise)
        if chance < 1e-12:
            break
        count += 1
        mean += chance
        square += chance * (2 * (count - center) - 1)
    return mean, square, fallen >= swing and scatter == 0


@compiled
def _edge(below, supply, lsb):  # type: ignore[no-untyped-def]
    """Output below which the ADC reads at most `below`; True if always or never."""
    if lsb == 0:
        return below, False, False
    code = np.floor(below / lsb)
    return (code + 0.5) * lsb, code >= np.rint(supply / lsb), code < 0


@compiled
def _chance(deeper, clearance, scatter, read_noise):  # type: ignore[no-untyped-def]
    """Probability that the clipped drop plus read noise exceeds a depth.

    `deeper` is how far the mean drop exceeds it, `clearance` how far the bottom does.
    """
    noise = math.hypot(scatter, read_noise)
    if noise == 0:
        return 1.0 if min(deeper, clearance) > 0 else 0.0
    h = deeper / noise
    if read_noise == 0:
        return _normal(h) if clearance > 0 else 0.0
    k = clearance / read_noise
    if scatter == 0 or abs(h) > _FAR or abs(k) > _FAR:
        return _normal(min(h, k))
    # Drezner and Wesolowsky, J. Stat. Comput. Simul. 35, 101 (1990), over the angle
    half = math.asin(read_noise / noise) / 2
    total = 0.0
    for node, weight in zip(_NODES, _WEIGHTS):  # noqa: B905
        angle = half * (1 + node)
        distance = h * h + k * k - 2 * h * k * math.sin(angle)
        total += weight * math.exp(-distance / (2 * math.cos(angle) ** 2))
    return _normal(h) * _normal(k) + half * total / (2 * math.pi)


@compiled
def _normal(z):  # type: ignore[no-untyped-def]
    return 0.5 * math.erfc(-z / math.sqrt(2))


class LawTable(NamedTuple):
    """Distributions of the number of events, one per row, with their sums."""

    least: Floats
    """Number of events of the first column, (K,)"""
    law: Floats
    """(K, N)"""
    center: Floats
    """Integer near the mean, (K,)"""
    sums: Floats
    """Cumulative sums of the distribution, alone and times the deviation from the center and its
    square, (3, K, N)"""

    @classmethod
    def of(cls, least: Floats, law: Floats) -> "LawTable":
        """Sum up distributions that start at these numbers of events."""
        columns = np.arange(law.shape[1])
        center = np.rint(least + law @ columns)
        deviation = least[:, None] + columns - center[:, None]
        return cls(least, law, center, np.cumsum([law, law * deviation, law * deviation**2], -1))


def tabulated_moments(
    counter: AnalogCounter,
    pixels: AnalogPixels,
    exposure_s: float,
    table: LawTable,
    rows: Ints,
    weights: Floats,
) -> tuple[Floats, Floats]:
    """Mean and variance of readings of exact pixels (P,), from tabulated distributions.

    Needed are a distribution's sums up to a pixel's own top, and the probabilities of the few
    numbers there. A pixel mixes those of the nearest entries with its own weights.

    `rows` (P,): first of the consecutive rows that a pixel mixes; `weights` (P, M): weights of
    these rows.
    """
    known = assumed_pixels(counter, pixels, exposure_s)
    mean, variance = np.empty(rows.size), np.empty(rows.size)
    _mix(pixels, known, voltages(counter), table, rows, weights, mean, variance)
    return mean, variance


@compiled
def _mix(pixels, known, volts, table, rows, weights, mean, variance):  # type: ignore[no-untyped-def]
    width = table.law.shape[1]
    for at in range(rows.size):
        pixel = _pixel_of(at, pixels, known, volts, True)
        first, center = rows[at], table.center[rows[at] + weights.shape[1] // 2]
        events = np.ceil(max(pixel.exact_below, 0.0))
        last, whole = -1.0, 0.0
        below = once = twice = 0.0
        for k in range(weights.shape[1]):
            row, weight = first + k, weights[at, k]
            last = max(last, table.least[row] + width - 1)
            whole += weight * table.sums[0, row, width - 1]
            column = min(int(events - table.least[row]), width) - 1
            if column < 0:
                continue
            shift = table.center[row] - center
            zero = table.sums[0, row, column]
            one, two = table.sums[1, row, column], table.sums[2, row, column]
            below += weight * zero
            once += weight * (one + shift * zero)
            twice += weight * (two + 2 * shift * one + shift**2 * zero)
        while events <= last:
            read, square, is_full = _read_of(events, center, pixel, volts)
            share = 0.0
            if is_full:
                share = whole - below
                events = last
            else:
                for k in range(weights.shape[1]):
                    column = int(events - table.least[first + k])
                    if 0 <= column < width:
                        share += weights[at, k] * table.law[first + k, column]
            below += share
            once += share * (read - center)
            twice += share * square
            events += 1
        mean[at] = center + once
        variance[at] = max(twice - once**2, 0.0)
