"""Mean and variance of a frame's readings: a counter's response times the distribution of events.

The response is the mean reading and mean square of a pixel after N events. A digital counter of
capacity C reads min(N, C) or N mod (C + 1). An analog one reads j or more if its output is below
the upper edge of the last ADC code for j. With a normal drop F_N of the output (step noise),
clipped at the bottom S of the swing, and read noise r,

    P(count >= j | N) = P(min(F_N, S) − r > t_j)          t_j: that edge, from supply and offset

is an integral of the normal distribution, two-dimensional near the bottom, and the response is a
sum over j. A counter that misreads fewer than one in 10⁵ events is treated as exact away from its
ends, with an error of its variance below 1e-5 counts².

Where all likely numbers of events are read exactly, readings have the moments of the events; where
all fill the counter, those of its response to one number.

**Many pixels**: in constant light, and where pixels differ at most in their counters, the
distribution depends on the mean number of arrivals a alone. A Poisson distribution moves by its own
standard deviation while x = 2·√a moves by 1, and distributions with dead time and afterpulses no
faster. So distributions at steps of 1/8 in x are computed, and polynomials through six of them
interpolate what is linear in them: the moments of identical counters, or for differing ones the
sums up to the number of events that a pixel reads exactly and the few probabilities above. The
error is below 2e-6 standard deviations of the reading, or with afterpulsing that of the moments of
events (`tests/sensor/spad/test_readings.py`).
"""

import math
from functools import lru_cache

import numpy as np
from scipy.special import ndtr

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.spad import counters
from megalopta.sensor.spad.distributions import event_distribution, likely_events
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.moments import Moments, count_moments, lagrange_weights

_LARGEST_GROUP = 100_000
"""Probabilities of pixels treated together, to stay in the second-level cache."""
_STEPS = 8
"""Distributions while 2·√a moves by 1."""
_POINTS, _BLOCK = 6, 64
"""Distributions that a polynomial connects, and that are computed and kept together."""
_FEW_MISREAD = 1e-5
_FAR = 7.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)

Counter = counters.DigitalCounter | counters.AnalogCounter


def moments_of_readings(
    arrivals: Floats | None,
    events: Moments,
    counter: Counter,
    pixels: counters.AnalogPixels | None,
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
        Differences between pixels in their avalanches.
    """
    shape, (events_mean, events_variance) = events[0].shape, (part.ravel() for part in events)
    pixels = pixels and counters.AnalogPixels(*(values.ravel() for values in pixels))
    mean, variance = events_mean.copy(), events_variance.copy()
    least, most = likely_events(mean, variance)
    if isinstance(counter, counters.AnalogCounter):
        assert pixels is not None
        capacity = np.floor((counter.swing_v - pixels.leaked_v) / pixels.step_v)
        is_open = _misreads(counter, pixels) | (most > capacity)
        # a slope of 1 takes 10 % more steps; their noise is below a ninth, taken nine times
        steps = 1.2 * counter.swing_v / pixels.step_v
        full = np.ceil(steps + np.sqrt(steps) + 1)
        is_full = is_open & (least >= full)
        certain = np.ones((np.count_nonzero(is_full), 1))
        mean[is_full], variance[is_full] = _respond(
            counter, _chosen(pixels, is_full), exposure_s, full[is_full], certain
        )
        is_open &= ~is_full
    elif counter.overflow == "saturate":
        is_full = least >= counter.capacity
        mean[is_full], variance[is_full] = counter.capacity, 0.0
        is_open = ~is_full & (most > counter.capacity)
    else:
        size = counter.capacity + 1
        mean -= least // size * size
        # with so wide a distribution all remainders are equally likely, to 3e-9
        is_even = variance > size**2
        mean[is_even], variance[is_even] = counter.capacity / 2, (size**2 - 1) / 12
        is_open = ~is_even & (least // size != most // size)
    left = np.flatnonzero(is_open)
    is_steady = arrivals is not None and maps is None and "crosstalk" not in effects.on
    arrivals = arrivals.ravel() if arrivals is not None and is_steady else None
    if arrivals is not None:
        is_done = np.zeros(left.size, np.bool_)
        is_alike = pixels is None or all(
            np.all(values[left] == values[left[:1]]) for values in pixels
        )
        x = 2 * np.sqrt(arrivals[left]) * _STEPS
        node = x.astype(np.int64) - (_POINTS // 2 - 1)
        weights = lagrange_weights(x - node, np.arange(float(_POINTS)))
        block_of_pixel = node // _BLOCK
        blocks = np.flatnonzero(np.bincount(block_of_pixel + 1)) - 1
        is_worth_it = left.size >= _BLOCK * blocks.size and (
            is_alike or not _misreads(counter, pixels)
        )
        for block in blocks.tolist() if is_worth_it else ():
            members = np.flatnonzero(block_of_pixel == block)
            distributions = _distributions(block, exposure_s, effects)
            if distributions is None:
                continue
            chosen, first_node = left[members], node[members] - block * _BLOCK
            if is_alike:
                alike = _chosen(pixels, np.full(_BLOCK + _POINTS - 1, left[0]))
                at_nodes = _respond(counter, alike, exposure_s, *distributions)
                around = first_node[:, None] + np.arange(_POINTS)
                mean[chosen], variance[chosen] = (
                    np.einsum("pk,pk->p", weights[members], values[around]) for values in at_nodes
                )
            else:
                differing = _chosen(pixels, chosen)
                mean[chosen], variance[chosen] = _respond(
                    counter, differing, exposure_s, *distributions, first_node, weights[members]
                )
            is_done[members] = True
        left = left[~is_done]
    left = left[np.argsort((most - least)[left], kind="stable")]
    while left.size:
        # pixels of similar width
        fits = ((most - least)[left] + 1) * np.arange(1, left.size + 1) <= _LARGEST_GROUP
        group, left = np.split(left, [max(int(fits.sum()), 1)])
        first, probability = event_distribution(
            None if arrivals is None else arrivals[group],
            events_mean[group],
            events_variance[group],
            exposure_s,
            effects,
        )
        mean[group], variance[group] = _respond(
            counter, _chosen(pixels, group), exposure_s, first, probability
        )
    return mean.reshape(shape), np.maximum(variance, 0.0).reshape(shape)


def _chosen(pixels: counters.AnalogPixels | None, chosen: Ints) -> counters.AnalogPixels | None:
    return pixels and counters.AnalogPixels(*(values[chosen] for values in pixels))


def _misreads(counter: Counter, pixels: counters.AnalogPixels | None) -> bool:
    """True if events are misread even away from the ends of the counter."""
    if isinstance(counter, counters.DigitalCounter) or pixels is None:
        return False
    is_clipped = counter.offset_sigma_v > 0 and counter.adc_bits is not None
    if not counter.calibrated or counter.step_slope or counter.step_noise_v or is_clipped:
        return True
    margin_v = (float(pixels.step_v.min(initial=counter.step_v)) - counter.lsb_v) / 2
    if counter.read_noise_v == 0:
        return margin_v <= 0
    return bool(2 * ndtr(-margin_v / counter.read_noise_v) > _FEW_MISREAD)


@lru_cache(maxsize=16)
def _distributions(
    block: int, exposure_s: float, effects: AvalancheEffects
) -> tuple[Floats, Floats, float, Floats] | None:
    """First number of events (K,), probabilities (K, N), a center and sums at a block of light."""
    # those below zero mirror those above
    x = (block * _BLOCK + np.arange(_BLOCK + _POINTS - 1)) / _STEPS
    arrivals = x**2 / 4
    mean, variance = count_moments(arrivals / exposure_s, exposure_s, effects)
    least, most = likely_events(mean, variance)
    if (most - least).max() * arrivals.size > 1_000_000:  # probabilities, too many to keep
        return None
    first, probability = event_distribution(arrivals, mean, variance, exposure_s, effects)
    return first, probability, *_sums(first, probability)


def _sums(first: Floats, probability: Floats) -> tuple[float, Floats]:
    """A center, and sums (3, K, N) of probability times distance from it to the power 0, 1, 2."""
    center = float(np.rint(np.mean(first) + probability.shape[1] / 2)) if first.size else 0.0
    distance = first[:, None] + np.arange(probability.shape[1]) - center
    weighted = probability * distance
    return center, np.cumsum([probability, weighted, weighted * distance], axis=-1)


def _respond(
    counter: Counter,
    pixels: counters.AnalogPixels | None,
    exposure_s: float,
    first: Floats,
    probability: Floats,
    center: float = 0.0,
    sums: Floats | None = None,
    rows: Ints | None = None,
    weights: Floats | None = None,
) -> Moments:
    """Mean and variance of the readings of pixels (P,): response times distribution.

    `probability` (K, N) is that of `first` (K,) and more events. A pixel mixes M distributions from
    `rows` (P,) on with `weights` (P, M), or has its own.
    """
    if isinstance(counter, counters.DigitalCounter):
        events = first[:, None] + np.arange(probability.shape[1])
        is_wrapped = counter.overflow == "wrap"
        size = counter.capacity + 1
        counts = events % size if is_wrapped else np.minimum(events, counter.capacity)
        mean = (probability * counts).sum(1)
        return mean, (probability * (counts - mean[:, None]) ** 2).sum(1)
    assert pixels is not None
    known = counters.assumed_pixels(counter, pixels, exposure_s)
    volts, is_exact = counters.voltages(counter), not _misreads(counter, pixels)
    if sums is None:  # which counters that misread do not need
        center, sums = _sums(first, probability[:, : probability.shape[1] * is_exact])
    rows = np.arange(first.size) if rows is None else rows
    weights = np.ones((rows.size, 1)) if weights is None else weights
    mean, variance = np.empty(rows.size), np.empty(rows.size)
    mixed = first, probability, sums, rows, weights
    _fill_moments(mixed, center, pixels, known, volts, is_exact, mean, variance)
    return mean, variance


@compiled
def _fill_moments(mixed, center, pixels, known, volts, is_exact, mean, variance):  # type: ignore[no-untyped-def]
    first, probability, sums, rows, weights = mixed
    points, width = weights.shape[1], probability.shape[1]
    for at in range(rows.size):
        row, step_v, leaked_v = rows[at], pixels.step_v[at], pixels.leaked_v[at]
        offset_v, known_step_v = pixels.offset_v[at], known.step_v[at]
        capacity = counters.largest_count(known_step_v, known.leaked_v[at], volts[1])
        exact_below = 0.0  # the number of events up to which all are read exactly
        if is_exact:
            exact_swing = volts[1] - leaked_v - _FAR * volts[4]
            exact_below = min(capacity, exact_swing / step_v)
        reference_v = volts[0] + known.offset_v[at] - known.leaked_v[at]
        pixel = step_v, leaked_v, offset_v, known_step_v, reference_v, capacity
        events = max(np.ceil(exact_below), first[row])
        below = once = twice = 0.0
        for point in range(points):
            column = min(int(events - 1 - first[row + point]), width - 1)
            if column >= 0:
                below += weights[at, point] * sums[0, row + point, column]
                once += weights[at, point] * sums[1, row + point, column]
                twice += weights[at, point] * sums[2, row + point, column]
        while events <= first[row + points - 1] + width - 1:
            read, square, is_full = _read_of(events, center, pixel, volts)
            share = 1 - below if is_full else 0.0
            for point in range(0 if is_full else points):
                column = int(events - first[row + point])
                if 0 <= column < width:
                    share += weights[at, point] * probability[row + point, column]
            below += share
            once += share * (read - center)
            twice += share * square
            events = np.inf if is_full else events + 1
        mean[at] = center + once
        variance[at] = max(twice - once**2, 0.0)


@compiled
def _read_of(events, center, pixel, volts):  # type: ignore[no-untyped-def]
    """Mean reading of a number of events, mean square about a center, and True if saturated."""
    supply, swing, slope, step_noise, read_noise, lsb = volts
    step_v, leaked_v, offset_v, step, reference, capacity = pixel
    fallen = counters.fall(events, step_v, slope, swing) + leaked_v
    scatter = counters.fall_deviation(events, step_noise, step_v, swing)
    noise = np.hypot(scatter, read_noise)
    reached = (min(fallen, swing) - offset_v + reference - supply) / step
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
            depth = supply + offset_v - edge
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
    """Probability that the clipped drop plus noise exceeds a depth `deeper` below its mean."""
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
