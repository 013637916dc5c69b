"""Moments of readings as functions of the light alone, tabulated.

Where pixels neither talk to each other nor differ in avalanches, and light is steady, what is read
depends on the mean number of arrivals a and the pixel's counter. A Poisson law moves by its own
standard deviation while x = 2·√a moves by 1, and laws with dead time and afterpulses no faster, so
that moments are smooth in x on that scale. They are tabulated at steps of 1/8 and interpolated by
polynomials through six entries, which is off by less than 2e-6 standard deviations of the reading,
or with afterpulsing, whose own tables are right to 3e-3, 2e-4
(`tests/sensor/spad/test_over_light.py`).

Of counters that are alike the moments themselves are tabulated, of analog ones that differ the laws
(`counters.tabulated`). Tables are kept while the program runs, 64 entries at a time.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor.avalanches.counts import count_moments
from megalopta.sensor.effects.fields import AvalancheEffects
from megalopta.sensor.spad.analog import AnalogCounter, AnalogPixels
from megalopta.sensor.spad.event_law import event_law, reach_of_events
from megalopta.sensor.spad.tabulated import LawTable, tabulated_moments

_STEPS = 8
"""Of the square root of the arrivals, doubled, to one."""
_POINTS = 6
_BLOCK = 64
_LARGEST_TABLE = 2_000_000
"""Probabilities of laws that are tabulated; more are not worth their memory."""

Moments = tuple[Floats, Floats]


def interpolated(arrivals: Floats, block: Callable[[int], Floats]) -> Moments | None:
    """Interpolate tabulated moments, unless that costs more than the moments of every pixel.

    Parameters
    ----------
    arrivals : (P,)
    block : function
        Of the number of a block, to mean and variance at its arrivals (`block_arrivals`), (2, 64).
    """
    first, weights, blocks = _places(arrivals)
    if arrivals.size < _BLOCK * len(blocks):
        return None
    table = np.concatenate([block(number) for number in blocks], axis=1)
    moments = np.empty((2, arrivals.size))
    _mix(first, weights, table, moments)
    return moments[0], moments[1]


def block_arrivals(number: int) -> Floats:
    """Mean arrivals at the entries of a block; those below none mirror those above."""
    x = (number * _BLOCK + np.arange(_BLOCK)) / _STEPS
    return np.asarray(x**2 / 4)


def by_tabulated_laws(
    arrivals: Floats,
    counter: AnalogCounter,
    pixels: AnalogPixels,
    exposure_s: float,
    effects: AvalancheEffects,
) -> Moments | None:
    """Moments of analog pixels that differ but do not misread, or none where laws are too large."""
    first, weights, blocks = _places(arrivals)
    if arrivals.size < _BLOCK * len(blocks):
        return None
    least, most = _reach_of_blocks(blocks, exposure_s, effects)
    if (most - least).max(initial=0) * least.size > _LARGEST_TABLE:
        return None
    table = _law_table(blocks, exposure_s, effects)
    return tabulated_moments(counter, pixels, exposure_s, table, first, weights)


def _places(arrivals: Floats) -> tuple[NDArray[np.int64], Floats, range]:
    """First entry of each pixel in the table, weights of its entries, and blocks of the table."""
    first, weights = np.empty(arrivals.size, np.int64), np.empty((arrivals.size, _POINTS))
    _weigh(arrivals, first, weights)
    blocks = range(
        int(first.min(initial=0)) // _BLOCK, int(first.max(initial=0) + _POINTS) // _BLOCK + 1
    )
    return first - blocks[0] * _BLOCK, weights, blocks


def _events(blocks: range, exposure_s: float, effects: AvalancheEffects) -> tuple[Floats, Moments]:
    arrivals = np.concatenate([block_arrivals(number) for number in blocks])
    mean, variance = count_moments(arrivals[:, None] / exposure_s, exposure_s, effects)
    return arrivals, (mean[:, 0], variance[:, 0])


@lru_cache(maxsize=16)
def _reach_of_blocks(blocks: range, exposure_s: float, effects: AvalancheEffects) -> Floats:
    return reach_of_events(*_events(blocks, exposure_s, effects)[1])


@lru_cache(maxsize=4)
def _law_table(blocks: range, exposure_s: float, effects: AvalancheEffects) -> LawTable:
    arrivals, moments = _events(blocks, exposure_s, effects)
    reach = reach_of_events(*moments)
    has_law = effects.on == {"dead_time"} and effects.dead_time.has_law
    law = event_law(arrivals, moments, exposure_s, effects, reach, has_law)
    return LawTable.of(reach[0], law)


@compiled
def _weigh(arrivals: Floats, first: NDArray[np.int64], weights: Floats) -> None:
    """First entry and weights of every pixel (Lagrange)."""
    for pixel in range(arrivals.size):
        x = 2 * np.sqrt(arrivals[pixel]) * _STEPS
        first[pixel] = int(x) - (_POINTS // 2 - 1)
        for own in range(_POINTS):
            weight = 1.0
            for other in range(_POINTS):
                if other != own:
                    weight *= (x - first[pixel] - other) / (own - other)
            weights[pixel, own] = weight


@compiled
def _mix(first: NDArray[np.int64], weights: Floats, table: Floats, moments: Floats) -> None:
    for pixel in range(first.size):
        mean = variance = 0.0
        for k in range(_POINTS):
            mean += weights[pixel, k] * table[0, first[pixel] + k]
            variance += weights[pixel, k] * table[1, first[pixel] + k]
        moments[0, pixel], moments[1, pixel] = mean, max(variance, 0.0)
