"""Crosstalk, afterpulses and rates of an array from time tags taken in the dark.

Crosstalk of two pixels from coincidences: of C pairs of their events within a window of ±w, C_u =
(N₁ − C_c)(N₂ − C_c)·2w/T are due to chance, and C_c = C − C_u to crosstalk. An avalanche in one of
them fires the other with a probability of C_c/(N₁ + N₂ − C_c). Afterpulses from pairs of events of
one pixel by lag (`autocorrelation`).

Source: Restelli et al., J. Mod. Opt. 53 (2006); Ingargiola et al., bioRxiv 207118 (2017).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.sensor.calibrate.autocorrelation import Autocorrelation
from megalopta.sensor.formats.time_tags import TimeTags

_ROUNDS = 50
_WITHIN = 0.25
"""Part of a unit by which a difference of times may err, which are stored as float64"""


class Coincidences(NamedTuple):
    """Crosstalk of all pairs of pixels, (M,)."""

    first: Ints
    second: Ints
    probability: Floats
    error: Floats


def events_of(tags: TimeTags) -> Ints:
    """Return the number of events of each channel."""
    return np.bincount(tags.channel, minlength=tags.channels)


def _later(time_s: Floats, longest_s: float) -> Iterator[tuple[Ints, Ints]]:
    """Yield indices of events, and of the first, second and later ones within a time of each."""
    index = np.arange(time_s.size)
    for step in range(1, time_s.size):
        index = index[index + step < time_s.size]
        index = index[time_s[index + step] - time_s[index] <= longest_s]
        if not index.size:
            return
        yield index, index + step


def coincidences(tags: TimeTags, window_s: float) -> Coincidences:
    """Return crosstalk of all pairs of channels, from events that are at most a window apart."""
    counts = np.zeros(tags.channels**2, np.int64)
    for one, other in _later(tags.time_s, window_s + _WITHIN * tags.unit_s):
        pair = np.sort((tags.channel[one], tags.channel[other]), axis=0)
        counts += np.bincount(pair[0] * tags.channels + pair[1], minlength=counts.size)
    first, second = np.triu_indices(tags.channels, 1)
    width_s = 2 * window_s
    if tags.unit_s:  # of times in whole units
        width_s = (2 * np.floor(window_s / tags.unit_s + _WITHIN) + 1) * tags.unit_s
    events, seen = events_of(tags), counts[first * tags.channels + second].astype(np.float64)
    by_crosstalk = np.zeros(seen.size)
    for _ in range(_ROUNDS):
        rest = (events[first] - by_crosstalk) * (events[second] - by_crosstalk)
        by_crosstalk = seen - rest * width_s / tags.duration_s
    avalanches = np.maximum(events[first] + events[second] - by_crosstalk, 1)
    return Coincidences(
        first, second, by_crosstalk / avalanches, np.sqrt(np.maximum(seen, 1)) / avalanches
    )


def autocorrelation_of(tags: TimeTags, edges_s: Floats) -> Autocorrelation:
    """Return pairs of events of each channel by lag, between edges (K + 1,)."""
    pairs = np.zeros((tags.channels, edges_s.size - 1))
    for channel in range(tags.channels):
        own = tags.time_s[tags.channel == channel]
        for one, other in _later(own, float(edges_s[-1])):
            lag_s = own[other] - own[one] + _WITHIN * tags.unit_s
            pairs[channel] += np.histogram(lag_s, edges_s)[0]
    return Autocorrelation(edges_s, pairs, events_of(tags).astype(np.float64))
