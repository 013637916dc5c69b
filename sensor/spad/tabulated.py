"""Moments of readings of analog pixels that differ, from one table of laws of events.

Where a counter reads events one for one up to near its capacity, what is wanted of the law of
events are sums up to the pixel's own top, and the probabilities of the few numbers there. Laws and
sums are tabulated over the light; a pixel mixes those of the nearest entries by weights of its own.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor.spad.analog import AnalogCounter, AnalogPixels, assumed_pixels, voltages
from megalopta.sensor.spad.counter_moments import pixel_of, read_of


class LawTable(NamedTuple):
    """Laws of the number of events, one a row, with their sums."""

    least: Floats
    """Number of events that the first column stands for, (K,)"""
    law: Floats
    """(K, N)"""
    center: Floats
    """Near the mean, a whole number, (K,)"""
    sums: Floats
    """Of the law, alone and times the deviation from the center and its square, up to each
    column, (3, K, N)"""

    @classmethod
    def of(cls, least: Floats, law: Floats) -> "LawTable":
        """Sum up laws that begin at these numbers of events."""
        columns = np.arange(law.shape[1])
        center = np.rint(least + law @ columns)
        deviation = least[:, None] + columns - center[:, None]
        return cls(least, law, center, np.cumsum([law, law * deviation, law * deviation**2], -1))


def tabulated_moments(
    counter: AnalogCounter,
    pixels: AnalogPixels,
    exposure_s: float,
    table: LawTable,
    rows: NDArray[np.int64],
    weights: Floats,
) -> tuple[Floats, Floats]:
    """Mean and variance of the readings of pixels (P,) that do not misread.

    Parameters
    ----------
    counter : AnalogCounter
    pixels : AnalogPixels
    exposure_s : float
    table : LawTable
    rows : (P,) int64
        First of the rows in a row whose laws a pixel mixes.
    weights : (P, M)
        Of these.
    """
    known = assumed_pixels(counter, pixels, exposure_s)
    mean, variance = np.empty(rows.size), np.empty(rows.size)
    _mix(pixels, known, voltages(counter), table, rows, weights, mean, variance)
    return mean, variance


@compiled
def _mix(pixels, known, volts, table, rows, weights, mean, variance):  # type: ignore[no-untyped-def]
    width = table.law.shape[1]
    for at in range(rows.size):
        pixel = pixel_of(at, pixels, known, volts, True)
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
            read, square, is_full = read_of(events, center, pixel, volts)
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
