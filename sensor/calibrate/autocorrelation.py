"""Afterpulses from the autocorrelation of a pixel's events.

After an event of a pixel, others follow at the rate of its light, and afterpulses, whose density
over the lag is p·f(t) for a few percent p with the distribution f of delays. The level of the light
is the mean over the longest lags: light must be steady over the lags that are used, and afterpulses
slower than these count as light.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import curve_fit

from megalopta.core.arrays import Floats
from megalopta.sensor.effects.afterpulsing import Afterpulsing

_BACKGROUND = 0.25
"""Share of the lags, the longest, that give the level of the light."""


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
        far = max(int(_BACKGROUND * rate.shape[1]), 1)
        return np.asarray(rate - rate[:, -far:].mean(axis=1, keepdims=True))


def fit_exponential(found: Autocorrelation) -> Afterpulsing:
    """Return afterpulsing with an exponential delay that fits the mean over the pixels.

    The number of carriers includes those released before the shortest lag. Raises ValueError if
    there are no afterpulses.
    """
    density, start, end = found.afterpulses.mean(axis=0), found.edges_s[:-1], found.edges_s[1:]
    seen = _seen(found)

    def mean_density(_: Floats, carriers: float, delay_s: float) -> Floats:
        part = np.exp(-start / delay_s) - np.exp(-end / delay_s)
        return np.asarray(1e6 * carriers * part / (end - start))

    guess = seen, float(np.sum(density * (end**2 - start**2) / 2) / seen)
    (carriers, delay_s), _ = curve_fit(
        mean_density, start, 1e6 * density, guess, bounds=(0, np.inf), x_scale=guess
    )
    return Afterpulsing(mean_carriers=min(carriers, 0.95), delay_s=delay_s)


def fit_table(found: Autocorrelation) -> Afterpulsing:
    """Return afterpulsing with the delays that are seen. Raises ValueError if there are none."""
    share = np.maximum(found.afterpulses.mean(axis=0), 0) * np.diff(found.edges_s)
    cumulative = np.concatenate(([0.0], np.cumsum(share) / share.sum()))
    cumulative[-1] = 1.0
    return Afterpulsing(
        mean_carriers=_seen(found),
        table_delays_s=tuple(found.edges_s.tolist()),
        table_cumulative=tuple(np.minimum(cumulative, 1.0).tolist()),
    )


def _seen(found: Autocorrelation) -> float:
    seen = float(np.sum(found.afterpulses.mean(axis=0) * np.diff(found.edges_s)))
    if not 0 < seen < 1:
        raise ValueError(f"{seen:.2g} afterpulses per event between {found.edges_s[0]:g} and "
                         f"{found.edges_s[-1]:g} s; give lags at which some are seen")  # fmt: skip
    return seen


def afterpulses_between(model: Afterpulsing, edges_s: Floats) -> Floats:
    """Return the afterpulses per event of a model between lags (K + 1,), without a dead time."""
    if model.table_delays_s:
        released = np.interp(edges_s, model.table_delays_s, model.table_cumulative)
    else:
        released = -np.expm1(-edges_s / model.delay_s)
    return np.asarray(model.mean_carriers * np.diff(released))
