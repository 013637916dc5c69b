"""Mean and variance of the counts of a gated pixel with paralyzable dead time, exact.

With O(t) the time that the gate has been open, an arrival at t is counted when the open part of the
dead time before it saw none,

    ν(t) = r·exp(−r·(O(t) − O(t−τ)))  while open, 0 while closed

counts per second, O being 0 before a live start. Two arrivals more than τ apart are counted
independently of each other, closer ones never both. So with m(t) = ∫₀ᵗ ν and w(t) = m(t) − m(t−τ),

    E[N] = m(T)          Var[N] = m(T) − 2·∫₀ᵀ ν(t)·w(t) dt

Between the edges of the gate, and these edges one and two dead times later, ν is constant or falls
as e^(−rt), and the integrals are elementary. From 2τ on everything repeats with the gate, so that
of a long exposure one period is integrated and the others are added.
"""

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled


def moments(
    rate_hz: Floats,
    exposure_s: float,
    dead_time_s: float,
    window: tuple[float, float, float],
    is_stationary: bool,
) -> tuple[Floats, Floats]:
    """Exact mean and variance of the counts.

    Parameters
    ----------
    rate_hz : array of any shape
        Rate of arrivals while the gate is open.
    exposure_s, dead_time_s : float
    window : (period_s, width_s, phase_s)
        Of the gate.
    is_stationary : bool
        Whether the detector has run for long, rather than being live and idle at the start.
    """
    period_s, width_s, phase_s = window
    repeats = max(int((exposure_s - 2 * dead_time_s) / period_s) - 1, 0)
    short_s = exposure_s - repeats * period_s
    cycles = np.arange(np.floor(-dead_time_s / period_s) - 1, np.ceil(short_s / period_s) + 1)
    openings = phase_s + cycles * period_s
    # the last repeated period ends at short_s
    edges = np.concatenate((openings, openings + width_s, [-dead_time_s, 0.0, short_s - period_s]))
    lagged = np.concatenate((edges, edges + dead_time_s, edges + 2 * dead_time_s, [short_s]))
    breaks = np.unique(lagged[(lagged >= -dead_time_s) & (lagged <= short_s)])
    middles = (breaks[1:] + breaks[:-1]) / 2
    is_open = (middles - phase_s) % period_s < width_s
    if not is_stationary:
        is_open &= middles > 0
    before = np.searchsorted(breaks, middles - dead_time_s) - 1
    offsets = breaks[:-1] - dead_time_s - breaks[before]
    is_last = middles > short_s - period_s
    rates = np.asarray(rate_hz, np.float64)
    mean, variance = np.empty(rates.size), np.empty(rates.size)
    steps = np.diff(breaks), is_open, before, offsets, middles > 0, is_last
    _integrate(rates.ravel(), steps, repeats, mean, variance)
    return mean.reshape(rates.shape), variance.reshape(rates.shape)


@compiled
def _integrate(rates, steps, repeats, mean, variance):  # type: ignore[no-untyped-def]
    durations, is_open, before, offsets, is_inside, is_last = steps
    opened = np.zeros(durations.size + 1)
    for k in range(durations.size):
        opened[k + 1] = opened[k] + durations[k] * is_open[k]
    counted = np.zeros(durations.size + 1)
    survived = np.zeros(durations.size)
    for pixel in range(rates.size):
        r = rates[pixel]
        pairs = last_pairs = last_counts = 0.0
        for k in range(durations.size):
            counted[k + 1] = counted[k]
            if not (is_inside[k] and is_open[k]):
                continue
            lag, offset, x = before[k], offsets[k], r * durations[k]
            dead_s = opened[k] - opened[lag] - offset * is_open[lag]
            survived[k] = np.exp(-r * dead_s)
            gained = survived[k] * (x if is_open[lag] else -np.expm1(-x))
            counted[k + 1] += gained
            # ∫ν·m(t−τ): where the gate was open a dead time ago, ν is constant
            early = counted[lag] * gained
            if is_open[lag] and is_inside[lag]:
                if is_open[before[lag]]:
                    grown = x * (r * offset + x / 2)
                else:
                    grown = x + np.exp(min(-r * offset, 700.0)) * np.expm1(-x)
                early += survived[k] * survived[lag] * grown
            close = counted[k] * gained + gained**2 / 2 - early
            pairs += close
            if is_last[k]:
                last_pairs += close
                last_counts += gained
        mean[pixel] = counted[-1] + repeats * last_counts
        variance[pixel] = mean[pixel] - 2 * (pairs + repeats * last_pairs)
