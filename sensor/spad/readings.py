"""Mean and variance of a frame's readings, from event distributions only where needed.

Without crosstalk and differences in avalanches between pixels, and in constant light, readings
depend on the mean number of arrivals a and the pixel's counter. A Poisson distribution moves by its
own standard deviation while x = 2·√a moves by 1, and distributions with dead time and afterpulses
no faster, so moments are smooth in x on that scale. They are tabulated at steps of 1/8 and
interpolated by polynomials through six entries. The error is below 2e-6 standard deviations of the
reading, or with afterpulsing that of its own tables (`tests/sensor/spad/test_readings.py`).

For identical counters the moments are tabulated, for differing analog ones the event distributions.
Tables are kept while the program runs, 64 entries at a time.
"""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc, lambertw

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.spad.counter_moments import (
    Counter,
    LawTable,
    counter_moments,
    events_until_full,
    misreads,
    simple_moments,
    tabulated_moments,
)
from megalopta.sensor.spad.counters import AnalogCounter, AnalogPixels
from megalopta.sensor.spad.counts import count_moments, fill_matched, reach_of_events
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.moments import lagrange

_LARGEST_LAW = 100_000
"""Probabilities of pixels treated together, to stay in the second-level cache."""
_STEPS = 8
"""Table entries while 2·√a moves by 1."""
_POINTS = 6
_BLOCK = 64
_LARGEST_TABLE = 2_000_000
"""Limit of tabulated probabilities; more are not worth their memory."""

Moments = tuple[Floats, Floats]
Places = NDArray[np.intp]


def moments_of_readings(
    arrivals: Floats | None,
    events: Moments,
    counter: Counter,
    pixels: AnalogPixels | None,
    exposure_s: float,
    effects: AvalancheEffects,
    maps: AvalancheMaps | None,
) -> Moments:
    """Return mean and variance of the readings of a frame.

    Parameters
    ----------
    arrivals : (rows, columns), optional
        Mean number of arrivals in constant light; None if light changes.
    events : (mean, variance)
        Moments of the events, each (rows, columns).
    pixels : AnalogPixels, optional
        Pixels of an analog counter.
    maps : AvalancheMaps, optional
    """
    reach = reach_of_events(*events)
    simple_mean, simple_variance, needs_law = simple_moments(counter, pixels, events, reach)
    mean, variance = np.array(simple_mean), np.array(simple_variance)
    until = np.broadcast_to(events_until_full(counter, pixels), mean.shape)
    is_full = reach[0] >= until
    has_law = effects.has_law and maps is None and arrivals is not None
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


def _groups(needs_law: Mask, width: Floats) -> Iterator[tuple[Places, Places]]:
    """Groups of pixels of similar width whose distributions fit into memory."""
    places = np.flatnonzero(needs_law)
    places = places[np.argsort(width.ravel()[places], kind="stable")]
    while places.size:
        widths = width.ravel()[places]
        fits = (widths + 1) * np.arange(1, places.size + 1) <= _LARGEST_LAW
        size = max(int(fits.sum()), 1)
        if widths[0] == 0:  # saturated
            size = min(size, int((widths == 0).sum()))
        rows, columns = np.unravel_index(places[:size], needs_law.shape)
        yield rows, columns
        places = places[size:]


def _tabulated(
    arrivals: Floats,
    counter: Counter,
    pixels: AnalogPixels | None,
    exposure_s: float,
    effects: AvalancheEffects,
) -> Moments | None:
    """Moments of pixels (P,) from tables over light, where possible and cheaper."""
    # the first entry of each pixel, and its weights of the entries (6, P) (Lagrange)
    x = 2 * np.sqrt(arrivals) * _STEPS
    first = x.astype(np.int64) - (_POINTS // 2 - 1)
    weights = np.array(lagrange(x - first, range(_POINTS)))
    low, high = int(first.min(initial=0)), int(first.max(initial=0)) + _POINTS
    blocks = range(low // _BLOCK, high // _BLOCK + 1)
    if arrivals.size < _BLOCK * len(blocks):
        return None
    first = first - blocks[0] * _BLOCK
    values = None if pixels is None else tuple(float(each[0]) for each in pixels)
    if pixels is None or all(np.all(each == each[0]) for each in pixels):
        table = np.concatenate(
            [_block(number, counter, values, exposure_s, effects) for number in blocks], axis=1
        )
        mean, variance = (sum(weights[k] * row[first + k] for k in range(_POINTS)) for row in table)
        return np.asarray(mean), np.maximum(variance, 0.0)
    assert isinstance(counter, AnalogCounter)
    laws = None if misreads(counter, pixels) else _laws(blocks, exposure_s, effects)
    if laws is None:
        return None
    return tabulated_moments(counter, pixels, exposure_s, laws, first, weights.T.copy())


def _block_arrivals(number: int) -> Floats:
    """Mean arrivals at the entries of a block; those below zero mirror those above."""
    x = (number * _BLOCK + np.arange(_BLOCK)) / _STEPS
    return np.asarray(x**2 / 4)


@lru_cache(maxsize=512)
def _block(
    number: int,
    counter: Counter,
    pixel: tuple[float, ...] | None,
    exposure_s: float,
    effects: AvalancheEffects,
) -> Floats:
    """Mean and variance of the readings of a pixel at the arrivals of a block, (2, 64)."""
    arrivals = _block_arrivals(number)[None]
    pixels = None
    if pixel is not None:
        pixels = AnalogPixels(*(np.full(arrivals.shape, value) for value in pixel))
    events = count_moments(arrivals / exposure_s, exposure_s, effects)
    # fewer pixels than are worth a table: by distribution
    moments = moments_of_readings(arrivals, events, counter, pixels, exposure_s, effects, None)
    return np.array(moments)[:, 0]


@lru_cache(maxsize=4)
def _laws(blocks: range, exposure_s: float, effects: AvalancheEffects) -> LawTable | None:
    """Event distributions at the arrivals of blocks; None if these are too large."""
    arrivals = np.concatenate([_block_arrivals(number) for number in blocks])
    mean, variance = count_moments(arrivals[:, None] / exposure_s, exposure_s, effects)
    moments = mean[:, 0], variance[:, 0]
    reach = reach_of_events(*moments)
    if (reach[1] - reach[0]).max(initial=0) * arrivals.size > _LARGEST_TABLE:
        return None
    law = event_law(arrivals, moments, exposure_s, effects, reach, effects.has_law)
    return LawTable.of(reach[0], law)


# Branches fall as (r·τ·e^(−rτ)/(2πk))^(T/τ).
_BRANCHES, _FEW_BRANCHES, _LONG = 8, 1, 20


def event_law(
    arrivals: Floats,
    moments: tuple[Floats, Floats],
    exposure_s: float,
    effects: AvalancheEffects,
    reach: Floats,
    has_law: bool,
) -> Floats:
    """Probability of each number of events, (P, N), from the smallest in reach on.

        none of the effects, or a gate     Poisson, exact
        non-paralyzable dead time          exact (`effects.nonparalyzable`)
        paralyzable dead time              exact (`_paralyzable`), to 3e-5 in exposures of half a
                                           dead time, 1e-9 from three on
        anything else                      matched in mean and variance (`counts.fill_matched`)

    Parameters
    ----------
    arrivals : (P,)
        Mean number of detectable photons plus dark counts, without the gate.
    moments : (mean, variance)
        Moments of the events, each (P,).
    reach : (2, P)
        Result of `reach_of_events`.
    has_law : bool
        True if all pixels have the same dead time and no other effect.
    """
    size = int((reach[1] - reach[0]).max(initial=0)) + 1
    dead, mean, variance = effects.dead_time, *moments
    if has_law and dead.kind == "nonparalyzable":
        fraction = dead.dead_time_s / exposure_s
        return _nonparalyzable(arrivals, fraction, dead.start == "stationary", reach[0], size)
    law = np.zeros((arrivals.size, size))
    if has_law:
        fraction = dead.dead_time_s / exposure_s
        law[arrivals == 0, 0] = 1.0
        for bright in np.unique(arrivals[arrivals > 0]):
            alike = np.flatnonzero(arrivals == bright)
            least = int(reach[0, alike[0]])
            law[alike] = _paralyzable(bright, fraction, dead.start == "stationary", least, size)
    else:
        fill_matched(mean, variance, np.ascontiguousarray(reach[0]), law)
    return law


def _nonparalyzable(
    arrivals: Floats, dead_fraction: float, is_stationary: bool, least: Floats, size: int
) -> Floats:
    """Differences of P(N >= n), from gammainc."""
    n = least[:, None] + np.arange(size + 1)
    lost = (arrivals * dead_fraction)[:, None]
    left = np.maximum(arrivals[:, None] - (n - 1) * lost, 0)
    reached = gammainc(np.maximum(n, 1e-9), left)
    if is_stationary:  # dead at the start for a time uniform up to the dead time
        blind = _integral(n, left) - _integral(n, np.maximum(left - lost, 0))
        reached = (reached + blind) / (1 + lost)
    reached[n <= 0] = 1.0
    return np.asarray(reached[:, :-1] - reached[:, 1:])


def _integral(n: Floats, upper: Floats) -> Floats:
    """Integral of P(n, y) over y from 0."""
    n = np.maximum(n, 1e-9)
    return np.asarray(upper * gammainc(n, upper) - n * gammainc(n + 1, upper))


def _paralyzable(
    arrivals: float, dead_fraction: float, is_stationary: bool, least: int, size: int
) -> Floats:
    """Fourier transform of the generating function.

    From the Laplace transforms in `effects.paralyzable`, with W_k the branches of Lambert's
    function at a·e^(−a)·(z − 1),

        E[z^N] = Σ_k z·a/(a + W_k)·e^(W_k·T/τ)/(1 + W_k)             live start
        E[z^N] = Σ_k e^(W_k·(T/τ + 1))/(1 + W_k)                     after running for long
    """
    points = size + 1 - size % 2  # odd, so that −1, where branches may meet, is excluded
    z = np.exp(2j * np.pi * np.arange(points // 2 + 1) / points)
    a = arrivals * dead_fraction
    total = np.zeros(z.size, complex)
    branches = _FEW_BRANCHES if 1 / dead_fraction > _LONG else _BRANCHES
    for branch in range(-branches, branches + 1):
        w = lambertw(a * np.exp(-a) * (z[1:] - 1), branch)
        start = np.exp(w) if is_stationary else z[1:] * a / (a + w)
        total[1:] += start * np.exp(w / dead_fraction) / (1 + w)
    total[0] = 1
    return np.asarray(np.fft.irfft((total * z**-least).conj(), points)[:size])
