"""Rates, crosstalk and afterpulses of an array from time tags taken in the dark.

**Crosstalk** of two pixels from coincidences: of C pairs of their events within a window of ±w, C_u
= (N₁ − C_c)(N₂ − C_c)·2w/T are due to chance, and C_c = C − C_u to crosstalk. An avalanche in one
of them fires the other with a probability of C_c/(N₁ + N₂ − C_c).

**Afterpulses** from pairs of events of one pixel by lag. After an event, others follow at the rate
of the light, and afterpulses, whose density over the lag is p·f(t) for a few percent p with the
distribution f of delays. The level of the light is the mean over the longest lags: light must be
steady over the lags that are used, and afterpulses slower than these count as light.

Source: Restelli et al., J. Mod. Opt. 53 (2006); Ingargiola et al., bioRxiv 207118 (2017).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.optimize import curve_fit

from megalopta.core.arrays import Floats, Ints
from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.formats.time_tags import TimeTags

_WITHIN = 0.25
"""Part of a unit by which a difference of times may err, which are stored as float64"""


class Autocorrelation(NamedTuple):
    """Pairs of events by lag, for every pixel."""

    edges_s: Floats
    """Ends of the lags, increasing, (K + 1,)"""
    pairs: Floats
    """Number of pairs of events with such a lag, (P, K)"""
    events: Floats
    """Events of each pixel, (P,)"""

    def of(self, pixels: slice, up_to_s: float = np.inf) -> "Autocorrelation":
        """Return some pixels, at lags up to a limit."""
        last = int(np.searchsorted(self.edges_s, up_to_s, "right")) - 1
        return Autocorrelation(
            self.edges_s[: last + 1], self.pairs[pixels, :last], self.events[pixels]
        )

    @property
    def afterpulses(self) -> Floats:
        """Afterpulses per event and second at each lag, (P, K)."""
        rate = self.pairs / (self.events[:, None] * np.diff(self.edges_s))
        # the longest lags give the level of the light
        far = max(int(0.25 * rate.shape[1]), 1)
        return np.asarray(rate - rate[:, -far:].mean(axis=1, keepdims=True))


def fit_exponential(lags: Autocorrelation) -> Afterpulsing:
    """Return afterpulsing with an exponential delay that fits the mean over the pixels.

    The number of carriers includes those released before the shortest lag. Raises ValueError if
    there are no afterpulses.
    """
    density, start, end = lags.afterpulses.mean(axis=0), lags.edges_s[:-1], lags.edges_s[1:]
    seen = _seen(lags)

    def mean_density(_: Floats, carriers: float, delay_s: float) -> Floats:
        part = np.exp(-start / delay_s) - np.exp(-end / delay_s)
        return np.asarray(1e6 * carriers * part / (end - start))

    # of few events, counting noise makes some densities negative
    weight = np.maximum(density, 0) * (end - start)
    guess = seen, float(np.sum(weight * (start + end) / 2) / weight.sum())
    (carriers, delay_s), _ = curve_fit(
        mean_density, start, 1e6 * density, guess, bounds=(0, np.inf), x_scale=guess
    )
    return Afterpulsing(mean_carriers=min(carriers, 0.95), delay_s=delay_s)


def fit_table(lags: Autocorrelation) -> Afterpulsing:
    """Return afterpulsing with the delays that are seen. Raises ValueError if there are none."""
    carriers = _seen(lags)
    share = np.maximum(lags.afterpulses.mean(axis=0), 0) * np.diff(lags.edges_s)
    cumulative = np.concatenate(([0.0], np.cumsum(share) / share.sum()))
    cumulative[-1] = 1.0
    return Afterpulsing(
        mean_carriers=carriers,
        table_delays_s=tuple(lags.edges_s.tolist()),
        table_cumulative=tuple(np.minimum(cumulative, 1.0).tolist()),
    )


def _seen(lags: Autocorrelation) -> float:
    """Return the afterpulses per event at these lags; ValueError if there are none."""
    seen = float(np.sum(lags.afterpulses.mean(axis=0) * np.diff(lags.edges_s)))
    if not 0 < seen < 1:
        raise ValueError(f"{seen:.2g} afterpulses per event between {lags.edges_s[0]:g} and "
                         f"{lags.edges_s[-1]:g} s; give lags at which some are seen")  # fmt: skip
    return seen


def afterpulses_between(model: Afterpulsing, edges_s: Floats) -> Floats:
    """Return the afterpulses per event of a model between lags (K + 1,), without a dead time."""
    if model.table_delays_s:
        released = np.interp(edges_s, model.table_delays_s, model.table_cumulative)
    else:
        released = -np.expm1(-edges_s / model.delay_s)
    return np.asarray(model.mean_carriers * np.diff(released))


class Coincidences(NamedTuple):
    """Crosstalk of all pairs of channels, (M,)."""

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
    for earlier, later in _later(tags.time_s, window_s + _WITHIN * tags.unit_s):
        pair = np.sort((tags.channel[earlier], tags.channel[later]), axis=0)
        counts += np.bincount(pair[0] * tags.channels + pair[1], minlength=counts.size)
    first, second = np.triu_indices(tags.channels, 1)
    width_s = 2 * window_s
    if tags.unit_s:  # of times in whole units
        width_s = (2 * np.floor(window_s / tags.unit_s + _WITHIN) + 1) * tags.unit_s
    events, seen = events_of(tags), counts[first * tags.channels + second].astype(np.float64)
    by_crosstalk = np.zeros(seen.size)
    for _ in range(50):
        chances = (events[first] - by_crosstalk) * (events[second] - by_crosstalk)
        by_crosstalk = seen - chances * width_s / tags.duration_s
    avalanches = np.maximum(events[first] + events[second] - by_crosstalk, 1)
    return Coincidences(
        first, second, by_crosstalk / avalanches, np.sqrt(np.maximum(seen, 1)) / avalanches
    )


def autocorrelation_of(tags: TimeTags, edges_s: Floats) -> Autocorrelation:
    """Return pairs of events of each channel by lag, between edges (K + 1,)."""
    pairs = np.zeros((tags.channels, edges_s.size - 1))
    for channel in range(tags.channels):
        time_s = tags.time_s[tags.channel == channel]
        for earlier, later in _later(time_s, float(edges_s[-1])):
            lag_s = time_s[later] - time_s[earlier] + _WITHIN * tags.unit_s
            pairs[channel] += np.histogram(lag_s, edges_s)[0]
    return Autocorrelation(edges_s, pairs, events_of(tags).astype(np.float64))
