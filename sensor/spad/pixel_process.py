"""Exact mean and variance of the counts of one pixel, without drawing any.

With dead time the state of a pixel is its place in the dead time and the number m of its trapped
carriers, which are released independently (exponential delays). Followed are the probability of
every state and the same weighted with the counts so far, in steps of a fraction of the dead time:

    live, m       fires at the rate of arrivals r plus m/delay, while the gate is open
    fired         m grows by a Poisson number; the pixel comes back a dead time later, when some of
                  the carriers have been released without effect
    twilight      comes back with a count, unless the last part of the dead time had no arrival
    recharging    live, by age since the dead time, with a part of the rate
    paralyzable   every arrival starts the dead time anew; live after one without an arrival

Within a step all flows are constant and live pixels change by the trapezoidal rule. So waits have
their exact mean and variance, and only higher cumulants an error of second order in the step.

Without dead time avalanches are a Hawkes process in the open time o(t), with a delay of density d
and p carriers. Each event at t has g(t) = 1 + p·∫ d(s − t)·o(s)·g(s) ds counts in the exposure, and

    rate m(t) = o(t)·(r + p·∫ d(t − s)·m(s) ds)        variance ∫ m(t)·g(t)² dt

Long after the start both moments grow along lines, or repeat with the gate; only the beginning is
computed then, up to three ends between which the slopes agree.
"""

import math

import numpy as np
from scipy.special import gammaln, xlogy

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.core.errors import UserError
from megalopta.sensor.effects.gating import open_time
from megalopta.sensor.spad.model import AvalancheEffects

MOST_WORK = 2e8
"""Largest number of operations for one rate, about 4 s."""
_FEWEST_STEPS, _STEPS_PER_WAIT, _STEPS_PER_GATED = 200, 2.5, 4
"""Least number of steps per exposure; steps per mean wait for an arrival; more with short gates."""
_FIRST_DEAD_TIMES, _FIRST_MEMORIES, _FIRST_PERIODS = 60, 3, 6
_OFF = 1e-4
_MOST_CARRIERS = 160
_CELLS_PER_MEMORY, _CELLS_PER_WINDOW = 400, 4


def counts_of_pixel(
    rate_hz: float, exposure_s: float, effects: AvalancheEffects
) -> tuple[float, float, float]:
    """Mean and variance of the counts of one exposure, without crosstalk, and operations taken.

    Raises UserError where they are not stated: dead time with tabulated delays or very many trapped
    carriers, or too many steps.
    """
    if rate_hz == 0:
        return 0.0, 0.0, 0.0
    moments_until = _with_dead_time if effects.dead_time.is_on else _without_dead_time
    dead_s, period_s = effects.dead_time.dead_time_s, effects.gate.period_s or 0.0
    first_s = max(
        _FIRST_DEAD_TIMES * dead_s, _FIRST_MEMORIES * effects.memory_s, _FIRST_PERIODS * period_s
    )
    total = 0.0
    while True:
        ends_s = [exposure_s]
        if 3 * first_s < exposure_s:
            # whole gate periods before the end of the exposure
            unit_s = period_s or first_s
            skipped = math.floor((exposure_s - 3 * first_s) / unit_s) * unit_s
            span_s = math.ceil(first_s / unit_s) * unit_s
            ends_s = [exposure_s - skipped - span_s * place for place in (2, 1, 0)]
        moments, work = moments_until(rate_hz, np.array(ends_s), effects)
        total += work
        if len(ends_s) == 1:
            return float(moments[0, 0]), float(moments[0, 1]), total
        slopes = np.diff(moments, axis=0) / span_s
        mean, variance = moments[2] + slopes[1] * skipped
        off_mean, off_variance = np.abs(slopes[1] - slopes[0]) * skipped
        if off_mean <= _OFF * mean and off_variance <= 10 * _OFF * max(variance, 1.0):
            return float(mean), float(variance), total
        first_s *= 4


def _with_dead_time(
    rate_hz: float, ends_s: Floats, effects: AvalancheEffects
) -> tuple[Floats, float]:
    """Mean and variance (E, 2) at some ends of the exposure, and operations taken."""
    dead, traps, gate = effects.dead_time, effects.afterpulsing, effects.gate.window
    if traps.is_on and traps.table_delays_s:
        raise UserError(
            "afterpulsing.table_delays_s: with dead time, mean and variance are stated for "
            "exponential delays alone; give delay_s, or ask for no expectation"
        )
    release_hz = 1 / traps.delay_s if traps.is_on else 0.0
    most_hz = rate_hz / (1 + rate_hz * dead.dead_time_s) / (1 - traps.mean_carriers)
    carried = traps.mean_carriers * min(most_hz, 1 / dead.dead_time_s) * traps.delay_s
    states = int(carried + 6 * carried**0.5 + 8) if traps.is_on else 1
    wait_s = 1 / (rate_hz + (carried + 1) * release_hz)
    if release_hz * dead.dead_time_s > 7:
        # carriers meet dead pixels, whose dead time they hardly extend
        is_extended = dead.kind == "paralyzable" and rate_hz * dead.dead_time_s > 0.01
        wait_s = min(1 / rate_hz, dead.dead_time_s / 4 if is_extended else math.inf)
    # waits for arrivals have their exact mean and variance in long steps, too
    longest = [dead.dead_time_s, wait_s / _STEPS_PER_WAIT, ends_s[-1] / _FEWEST_STEPS]
    if dead.recharge_s:
        longest += [dead.recharge_s / 12, (dead.recharge_s / rate_hz) ** 0.5 / 8]
    if gate[0]:  # which opens and closes within steps
        is_short = gate[1] < 30 * dead.dead_time_s
        longest = [min(longest) / (_STEPS_PER_GATED if is_short else 1), gate[1] / 100]
    steps = math.ceil(dead.dead_time_s / min(longest))
    warm_s = 0.0
    if dead.start == "stationary":
        warm_s = 20 * dead.dead_time_s + effects.memory_s
        warm_s = math.ceil(warm_s / dead.dead_time_s) * dead.dead_time_s
    step_s = dead.dead_time_s / steps
    efficiencies = np.ones(1)
    if dead.recharge_s:
        # by the steps since the one in which the dead time ended, until hardly any pixel waits
        waits = np.linspace(0, 14, 1401)
        waited = rate_hz * dead.recharge_s * (waits + np.expm1(-waits))
        last = float(waits[min(int(np.searchsorted(waited, 30.0)), waits.size - 1)])
        fraction = step_s / dead.recharge_s
        passed = np.arange(math.ceil(last / fraction) + 2)
        grown = -np.expm1(-fraction) / fraction
        efficiencies = 1 - np.exp(-(passed - 1) * fraction) * grown**2
        efficiencies[0] = 1 - 2 * (1 - grown) / fraction  # of those that come in this step
        efficiencies = np.append(efficiencies, 1.0)
    ages = efficiencies.size
    work = (ends_s[-1] + warm_s) / step_s * (4 + states * (states + 2 * ages))
    if work > MOST_WORK or states > _MOST_CARRIERS:
        raise UserError(
            f"mean and variance at {rate_hz:.3g} detections and dark counts per second take too "
            "long to compute with these effects; lower the light, exposure_s or "
            "afterpulsing.delay_s, or ask for no expectation"
        )
    is_paralyzable, twilight_s = dead.kind == "paralyzable", min(dead.twilight_s, dead.dead_time_s)
    pixel = rate_hz, step_s, dead.dead_time_s, is_paralyzable, twilight_s, release_hz, gate, warm_s
    moments = np.empty((len(ends_s), 2))
    number = np.arange(states)
    trapped = np.exp(xlogy(number, traps.mean_carriers) - traps.mean_carriers - gammaln(number + 1))
    _follow(pixel, trapped, efficiencies, steps, ends_s, moments)
    return moments, work


@compiled
def _follow(pixel, trapped, efficiencies, steps, ends_s, moments):  # type: ignore[no-untyped-def]
    """Fill in mean and variance (E, 2) at the ends of the exposure."""
    rate, step, tau, is_paralyzable, twilight, release, gate, warm = pixel
    states, window = trapped.size, tau if is_paralyzable else twilight
    # probabilities and the same weighted with counts; pixels that wait by age, the last for good
    ages = efficiencies.size
    waiting, older = np.zeros((ages, 2, states)), np.zeros((ages, 2, states))
    fired, dead = np.zeros((steps, 2, states)), np.zeros((2, states))
    fires, pulses = np.zeros((2, states)), np.zeros((2, states))
    back, arrived = np.zeros((2, states)), np.zeros((2, states))
    silent, all_back = np.zeros((states, states)), np.zeros((states, states))
    last_open, at_end, start = -1.0, 0, round(warm / step)
    waiting[-1, 0, 0] = 1.0
    if warm > 0:
        # in equilibrium without afterpulses
        counts_hz = rate / (rate * tau + math.exp(-rate * twilight))
        waiting[-1, 0, 0] = 1 - counts_hz * tau
        if is_paralyzable:
            counts_hz, waiting[-1, 0, 0] = rate, math.exp(-rate * tau)
        fired[:, 0, 0] = counts_hz * step
        dead[0, 0] = 1 - waiting[-1, 0, 0]
    mean = square = 0.0
    for k in range(2**62):
        time, place = (k - start) * step, k % steps
        if k == start:
            mean = square = 0.0
            waiting[:, 1], dead[1], fired[:, 1] = 0.0, 0.0, 0.0
        opened = (open_time(time + step, *gate) - open_time(time, *gate)) / step
        # come back from the dead time
        open_s = open_time(time + step / 2, *gate) - open_time(time + step / 2 - window, *gate)
        if abs(open_s - last_open) > 1e-9 * tau:
            _returns(rate, release, tau, window, open_s, silent, all_back)
            last_open = open_s
        for w in range(2):
            for m in range(states):
                total = pulse = 0.0
                for n in range(m, states):
                    total += silent[m, n] * fired[place, w, n]
                    pulse += all_back[m, n] * fired[place, w, n]
                back[w, m] = total
                if not is_paralyzable and twilight > 0:
                    pulses[w, m] = opened * (pulse - total)
                    back[w, m] += (1 - opened) * (pulse - total)
        flows = back, pulses, efficiencies, waiting
        arrival, leave = rate * opened * step, min(release * step, 0.5)
        if ends_s[at_end] < time + step * (1 - 1e-9):
            # a part of the step changes nothing
            length = max((ends_s[at_end] - time) / step, 0.0)
            once, twice = _wait(flows, arrival, leave, opened, length, older, fires)
            moments[at_end, 0] = mean + once
            moments[at_end, 1] = max(square + twice - (mean + once) ** 2, 0.0)
            at_end += 1
            if at_end == ends_s.size:
                return
        once, twice = _wait(flows, arrival, leave, opened, 1.0, older, fires)
        waiting, older = older, waiting
        mean += once
        square += twice
        # fill traps; counted fires weigh one more
        fires[1] += fires[0]
        arrived[:] = 0.0
        for w in range(2):
            for n in range(states):
                for more in range(states):
                    arrived[w, min(n + more, states - 1)] += trapped[more] * fires[w, n]
        if is_paralyzable:
            _extend(dead, back, arrival, leave, opened, arrived)
        fired[place] = arrived


@compiled
def _wait(flows, arrival, leave, opened, length, older, fires):  # type: ignore[no-untyped-def]
    """Follow waiting pixels through a part of a step; return new counts, and those of squares.

    `leave` is the chance of a carrier to be released in the whole step, `arrival` that of an event.
    """
    back, pulses, efficiencies, waiting = flows
    ages, _, states = waiting.shape
    arrival, leave = arrival * length, leave * length
    fires[:], older[:] = 0.0, 0.0
    for age in range(ages):
        efficiency = efficiencies[age]
        effective = opened * efficiency
        for w in range(2):
            lost = 0.0
            for m in range(states - 1, -1, -1):
                entering, present = length * back[w, m] * (age == 0) + lost, waiting[age, w, m]
                out = arrival * efficiency + m * leave
                after = ((1 - out / 2) * present + entering) / (1 + out / 2)
                between = (present + after) / 2
                fires[w, m] += arrival * efficiency * between
                lost = 0.0
                if m > 0:
                    fires[w, m - 1] += m * leave * effective * between
                    lost = m * leave * (1 - effective) * between
                older[min(age + 1, ages - 1), w, m] += after
    once = twice = 0.0
    for m in range(states):
        fires[0, m] += length * pulses[0, m]
        fires[1, m] += length * pulses[1, m]
        once += fires[0, m]
        twice += 2 * fires[1, m] + fires[0, m]
    return once, twice


@compiled
def _extend(dead, back, arrival, leave, opened, arrived):  # type: ignore[no-untyped-def]
    """Let arrivals and released carriers start a paralyzable dead time anew."""
    for w in range(2):
        released, effective = 0.0, 0.0
        for m in range(dead.shape[1] - 1, -1, -1):
            out = m * leave
            after = (1 - out / 2) * dead[w, m] + arrived[w, m] + released - back[w, m]
            after /= 1 + out / 2
            between = (dead[w, m] + after) / 2
            dead[w, m] = after
            arrived[w, m] += arrival * between + effective
            released = out * between
            effective = opened * released


@compiled
def _returns(rate, release, tau, window, open_s, silent, all_back):  # type: ignore[no-untyped-def]
    """Chances to come back from n carriers with m: without arrival in the window, and at all."""
    states = len(silent)
    opened = open_s / window if window > 0 else 0.0
    before = math.exp(-release * (tau - window))
    kept = math.exp(-release * window)
    idle = (1 - kept) * (1 - opened)
    for n in range(states):
        for m in range(n + 1):
            ways = math.exp(math.lgamma(n + 1) - math.lgamma(m + 1) - math.lgamma(n - m + 1))
            keep = (before * kept) ** m
            # released before the window, or in it while the gate is closed
            silent[m, n] = ways * keep * (1 - before + before * idle) ** (n - m)
            silent[m, n] *= math.exp(-rate * open_s)
            all_back[m, n] = ways * keep * (1 - before * kept) ** (n - m)


def _without_dead_time(
    rate_hz: float, ends_s: Floats, effects: AvalancheEffects
) -> tuple[Floats, float]:
    """Mean and variance (E, 2) at some ends of the exposure, and operations taken."""
    traps, gate = effects.afterpulsing, effects.gate.window
    longest_s = traps.table_delays_s[-1] if traps.table_delays_s else 20 * traps.delay_s
    moments, work = [], 1e6
    for end_s in ends_s:
        cell_s = longest_s / _CELLS_PER_MEMORY
        if gate[0]:
            cell_s = min(cell_s, max(gate[1] / _CELLS_PER_WINDOW, cell_s / 20))
        cell_s = end_s / math.ceil(end_s / min(cell_s, end_s / 16))
        warm = math.ceil(effects.memory_s / cell_s) if effects.dead_time.start != "live" else 0
        cells = warm + round(end_s / cell_s)
        work += cells * min(cells, longest_s / cell_s)
        if work > MOST_WORK:
            raise UserError(
                f"afterpulsing: delays up to {longest_s:.3g} s take too long to follow through an "
                f"exposure_s of {end_s:.3g}; shorten the delay or lengthen the exposure"
            )
        edges_s = cell_s * np.arange(-warm, round(end_s / cell_s) + 1)
        opened = np.diff([open_time(time_s, *gate) for time_s in edges_s]) / cell_s
        # carriers released so many cells later
        fine_s = np.arange(8 * (math.ceil(longest_s / cell_s) + 2) + 1) * cell_s / 8
        if traps.table_delays_s:
            released = np.interp(fine_s, traps.table_delays_s, traps.table_cumulative)
        else:
            released = -np.expm1(-fine_s / traps.delay_s)
        # from a place anywhere in a cell: linear between the cells
        integral = np.concatenate([[0.0], np.cumsum((released[1:] + released[:-1]) / 16)])[::8]
        shares = np.diff(integral, n=2, prepend=0.0)
        released_later = np.asarray(traps.mean_carriers * shares / shares.sum())
        moments.append(_hawkes(opened, warm, rate_hz * cell_s, released_later))
    return np.array(moments), work


@compiled
def _hawkes(opened: Floats, warm: int, arrivals: float, lags: Floats) -> tuple[float, float]:
    """Mean and variance from the open part of every cell, the first `warm` of which are before."""
    counts, progeny = np.zeros(opened.size), np.zeros(opened.size)
    for k in range(opened.size):
        total = arrivals
        for lag in range(1, min(lags.size, k + 1)):
            total += lags[lag] * counts[k - lag]
        counts[k] = opened[k] * total / (1 - lags[0] * opened[k])
    for k in range(opened.size - 1, -1, -1):
        total = 1.0 if k >= warm else 0.0
        for lag in range(1, min(lags.size, opened.size - k)):
            total += lags[lag] * opened[k + lag] * progeny[k + lag]
        progeny[k] = total / (1 - lags[0] * opened[k])
    mean = square = 0.0
    for k in range(opened.size):
        mean += counts[k] * (k >= warm)
        square += counts[k] * progeny[k] ** 2
    return mean, square
