"""Mean and variance of the readings of a frame, by a law of events only where that is needed."""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.avalanches.counts import count_moments
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.fields import AvalancheEffects
from megalopta.sensor.spad.analog import AnalogCounter, AnalogPixels
from megalopta.sensor.spad.counter_moments import (
    counter_moments,
    events_until_full,
    misreads,
    simple_moments,
)
from megalopta.sensor.spad.digital import DigitalCounter
from megalopta.sensor.spad.event_law import event_law, reach_of_events
from megalopta.sensor.spad.over_light import block_arrivals, by_tabulated_laws, interpolated

_LARGEST_LAW = 100_000
"""Probabilities of pixels that are treated together: they stay in a processor's second cache."""

Moments = tuple[Floats, Floats]
Places = NDArray[np.intp]
Counter = DigitalCounter | AnalogCounter


def moments_of_readings(
    arrivals: Floats | None,
    events: Moments,
    counter: Counter,
    pixels: AnalogPixels | None,
    exposure_s: float,
    effects: AvalancheEffects,
    maps: AvalancheMaps | None,
) -> Moments:
    """Mean and variance of the readings of a frame.

    Parameters
    ----------
    arrivals : (rows, columns), optional
        Mean number of arrivals in steady light; none where light changes.
    events : (mean, variance)
        Of the events, each (rows, columns).
    counter : DigitalCounter or AnalogCounter
    pixels : AnalogPixels, optional
        Of an analog counter.
    exposure_s : float
    effects : AvalancheEffects
    maps : AvalancheMaps, optional
    """
    reach = reach_of_events(*events)
    simple_mean, simple_variance, needs_law = simple_moments(counter, pixels, events, reach)
    mean, variance = np.array(simple_mean), np.array(simple_variance)
    until = np.broadcast_to(events_until_full(counter, pixels), mean.shape)
    is_full = reach[0] >= until
    has_law = effects.on == {"dead_time"} and effects.dead_time.has_law
    has_law = has_law and maps is None and arrivals is not None
    if arrivals is not None and maps is None and not effects.crosstalk.is_on:
        chosen = np.nonzero(needs_law & ~is_full)
        found = _tabulated(arrivals[chosen], counter, _at(pixels, chosen), exposure_s, effects)
        if found is not None:
            mean[chosen], variance[chosen] = found
            needs_law = needs_law & is_full
    arrivals = events[0] if arrivals is None else arrivals
    for chosen in _groups(needs_law, np.where(is_full, 0, reach[1] - reach[0])):
        first, law = until[chosen], np.ones((len(chosen[0]), 1))
        if not is_full[chosen].all():
            first, within = reach[0][chosen], (events[0][chosen], events[1][chosen])
            ends = reach[:, chosen[0], chosen[1]]
            law = event_law(arrivals[chosen], within, exposure_s, effects, ends, has_law)
        mean[chosen], variance[chosen] = counter_moments(
            counter, _at(pixels, chosen), exposure_s, first, law
        )
    return mean, variance


def _at(pixels: AnalogPixels | None, places: tuple[Places, ...]) -> AnalogPixels | None:
    return None if pixels is None else AnalogPixels(*(each[places] for each in pixels))


def _tabulated(
    arrivals: Floats,
    counter: Counter,
    pixels: AnalogPixels | None,
    exposure_s: float,
    effects: AvalancheEffects,
) -> Moments | None:
    """Moments of pixels (P,) from tables over the light, where that is possible and cheaper."""
    if not arrivals.size:
        return None
    values = None if pixels is None else tuple(float(each[0]) for each in pixels)
    if pixels is None or all(np.all(each == each[0]) for each in pixels):
        return interpolated(
            arrivals,
            lambda number: _block(number, counter, values, exposure_s, effects),
        )
    assert isinstance(counter, AnalogCounter)
    if misreads(counter, pixels):
        return None
    return by_tabulated_laws(arrivals, counter, pixels, exposure_s, effects)


@lru_cache(maxsize=512)
def _block(
    number: int,
    counter: Counter,
    pixel: tuple[float, ...] | None,
    exposure_s: float,
    effects: AvalancheEffects,
) -> Floats:
    """Mean and variance of the readings of a pixel at the arrivals of a block, (2, 64)."""
    arrivals = block_arrivals(number)[None]
    pixels = None
    if pixel is not None:
        pixels = AnalogPixels(*(np.full(arrivals.shape, value) for value in pixel))
    events = count_moments(arrivals / exposure_s, exposure_s, effects)
    # fewer pixels than would be worth a table: by law
    moments = moments_of_readings(arrivals, events, counter, pixels, exposure_s, effects, None)
    return np.array(moments)[:, 0]


def _groups(needs_law: NDArray[np.bool_], width: Floats) -> Iterator[tuple[Places, Places]]:
    """Pixels, in groups of about equal width, whose laws fit into memory."""
    places = np.flatnonzero(needs_law)
    places = places[np.argsort(width.ravel()[places], kind="stable")]
    while places.size:
        widths = width.ravel()[places]
        fits = (widths + 1) * np.arange(1, places.size + 1) <= _LARGEST_LAW
        size = max(int(fits.sum()), 1)
        if widths[0] == 0:  # full
            size = min(size, int((widths == 0).sum()))
        rows, columns = np.unravel_index(places[:size], needs_law.shape)
        yield rows, columns
        places = places[size:]
