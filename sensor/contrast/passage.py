"""First passages of the noisy output of pixels, which do not depend on time steps.

In a step of constant bandwidth the output about its moving mean, u, is an Ornstein-Uhlenbeck
process, and B(s) = u·e^(t/τ) a Brownian motion of variance σ²·s with s = e^(2t/τ) − 1.

- The end of a step is a normal number. Between, B is a bridge, which crosses a straight barrier
  with probability exp(−2·d₀·d₁/(σ²·Δs)), first at an s of which s/(Δs − s) is inverse Gaussian
  (Borodin and Salminen, Handbook of Brownian Motion, 2002). Where the barrier is b above the
  straight one, the crossing is kept with probability exp(−2·b·d₁/(σ²·(Δs − s))), exact to first
  order in b.
- Far from both barriers steps are long. Passages are then rare: they have the rate of a stationary
  process, and are late by the mean time to the barrier less that from the average place. The mean
  time from u to x is τ·(G(x) − G(u)), u and x in σ, G(x) = ∫ √(2π)·e^(y²/2)·Φ(y) dy from 0
  (Siegert, Phys. Rev. 81, 617, 1951).

A threshold is at least three standard deviations of a short step, so that only one of the barriers
is crossed in it.
"""

import math
from functools import cache

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.special import log_ndtr, ndtr

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled

_STEP, _LONG, _CLEAR = 0.3, 2.0, 3.5
"""Short steps, and the shortest long ones, in τ; distance from barriers that allows these, in σ"""
_MOST_CHANGE = 0.5
"""Of ln λ in a step, in whose middle τ and σ are taken"""
_NEGLIGIBLE = 18.0
"""Exponent of a crossing that is omitted"""
_FARTHEST = 9.0
"""Barrier beyond which rare passages are omitted, σ"""


@cache
def passage_tables() -> Floats:
    """Return G, its mean over stationary places below a barrier, and ln(rate·τ), (3, 1801).

    Places are from −9 to 9 σ.
    """
    place = np.linspace(-_FARTHEST, _FARTHEST, 1801)
    slope = math.sqrt(2 * math.pi) * np.exp(place**2 / 2 + log_ndtr(place))
    waits = cumulative_trapezoid(slope, place, initial=0)
    waits -= waits[900]
    density = np.exp(-(place**2) / 2) / math.sqrt(2 * math.pi)
    means = cumulative_trapezoid(density * waits, place, initial=0) / ndtr(place)
    return np.array([waits, means, -np.log(np.maximum(waits - means, 1e-300))])


@compiled
def run_pixels(rng, parameters, tables, part_s, light, thresholds, state, most):  # type: ignore[no-untyped-def]
    """Return times (s), and 2 · pixel + ON, of the events of a frame, in the order of pixels.

    `light` (S + 1, N) is ln λ at the ends of parts, straight between; `thresholds` (2, N) ON and
    OFF; `state` (4, N) is changed. Stops after `most` events.
    """
    fastest_s, charge_e, noise, leak_hz, refractory_s = parameters
    times, codes, count = np.empty(1024), np.empty(1024, np.int64), 0
    for n in range(light.shape[1]):
        _, v, r, held = state[:, n]
        up, down = thresholds[0, n], thresholds[1, n]
        for part in range(light.shape[0] - 1):
            slope = (light[part + 1, n] - light[part, n]) / part_s
            closing = slope + leak_hz * up  # of the barriers on the output's mean
            t = until = 0.0
            while t < part_s:
                lag = light[part, n] + slope * t
                if t == until:  # τ and σ for the next piece
                    until = part_s
                    if abs(slope) * (part_s - t) > _MOST_CHANGE:
                        until = t + _MOST_CHANGE / abs(slope)
                    rate = math.exp(lag + slope * (until - t) / 2)
                    tau = max(fastest_s, charge_e / rate)
                    sigma = math.sqrt(noise / (2 * rate * tau))
                    short_s, ratio = tau, np.nan
                    if sigma > 0:
                        short_s *= min(1, _STEP * (1 + abs(closing) * tau / sigma))
                        short_s = min(short_s, tau * (min(up, down) / (3 * sigma)) ** 2 / 2)
                follows = lag - slope * tau
                u, on, off = v - follows, r + up - follows, r - down - follows
                rise, fall = on - max(u, 0.0) - _CLEAR * sigma, off - min(u, 0.0) + _CLEAR * sigma
                h = until - t
                if closing:
                    h = min(h, (rise if closing > 0 else fall) / closing)
                is_long = held == 0 and rise > 0 > fall and h > _LONG * tau
                if not is_long:
                    h = min(until - t, held if held > 0 else short_s)
                if h / tau != ratio:
                    ratio = h / tau
                    decay = math.exp(-ratio)
                    width = sigma * math.sqrt(1 - decay * decay)
                end = u * decay + width * rng.standard_normal()
                sure, crossed, polarity = _NEGLIGIBLE / 2 * width * width / decay, h, 0
                for sign in (1, -1):
                    start, far = (on, on - closing * h) if sign > 0 else (-off, closing * h - off)
                    first, last = start - sign * u, far - sign * end
                    at = np.inf
                    if is_long and sigma > 0 and start + far < 2 * _FARTHEST * sigma:
                        place = (start + far) / (2 * sigma)
                        at = tau * _rare(rng, tables, place, sign * u / sigma)
                    elif not (is_long or held > 0 or (last > 0 and first * last >= sure)):
                        crossing = first, last / decay, start, far, width / decay
                        at = _bridge(rng, crossing, decay, h, tau)
                    if at < crossed:
                        crossed, polarity = at, sign
                for _ in range(20 if is_long and polarity == 0 else 0):  # draws that mostly suffice
                    if off - closing * h < end < on - closing * h:
                        break  # the path ends without a crossing
                    end = u * decay + width * rng.standard_normal()
                v = follows + slope * h + end
                r -= (closing - slope) * crossed
                if held > 0:
                    held = held - h if h < held else 0.0
                    r = v
                if polarity:
                    if count == times.size:
                        if count >= most:
                            return times, codes
                        times, codes = np.append(times, times), np.append(codes, codes)
                    times[count], codes[count] = part * part_s + t + crossed, 2 * n + (polarity > 0)
                    count += 1
                    r += up if polarity > 0 else -down
                    v, held = r, refractory_s
                t = t + crossed if crossed < until - t else until
        state[0, n], state[1, n], state[2, n], state[3, n] = light[-1, n], v, r, held
    return times[:count], codes[:count]


@compiled
def _bridge(rng, crossing, decay, h, tau):  # type: ignore[no-untyped-def]
    """Time of the first crossing in a step, infinite without one.

    `crossing`: distances from a barrier at both ends, in units of B, its heights there, in those of
    u, and the standard deviation of B in the step.
    """
    first, last, start, end, width = crossing
    if first <= 0:
        return 0.0
    if last > 0 and rng.standard_exponential() <= 2 * first * last / width**2:
        return np.inf
    mean = first / max(abs(last), 1e-12 * first)
    spread = mean * (rng.standard_normal() * width / first) ** 2
    odds = mean / (1 + spread / 2 + math.sqrt(spread + spread * spread / 4))
    if rng.random() * (mean + odds) > mean:
        odds = mean * mean / odds
    place, span = odds / (1 + odds), 1 / decay**2 - 1
    at = tau * math.log1p(place * span) / 2
    if last > 0:
        height = (start + (end - start) * at / h) * math.sqrt(1 + place * span)
        bend = height - start - (end / decay - start) * place
        if rng.standard_exponential() <= 2 * bend * last * (1 + odds) / width**2:
            return np.inf
    return at


@compiled
def _rare(rng, tables, barrier, u):  # type: ignore[no-untyped-def]
    """Time of a rare crossing, in τ, of a barrier at so many σ."""
    late = _looked_up(tables, 1, barrier) - _looked_up(tables, 0, u)
    wait = rng.standard_exponential() / math.exp(_looked_up(tables, 2, barrier))
    return max(late + wait, 0.0)


@compiled
def _looked_up(tables, row, place):  # type: ignore[no-untyped-def]
    share = max((place + _FARTHEST) * 100, 0.0)
    low = int(share)
    return tables[row, low] + (tables[row, low + 1] - tables[row, low]) * (share - low)
