"""Stated moments of afterpulses against those of a self-exciting process, in closed form."""

from collections.abc import Iterator

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor.avalanches import NODES_PER_DECADE, count_moments
from megalopta.sensor.effects import Afterpulsing, AvalancheEffects, DeadTime, afterpulsing
from megalopta.sensor.selfcheck.comparison import Row, exact_row

_RELATIVE_ERROR = 1e-6


def check_stated_afterpulsing() -> Iterator[Row]:
    """A long exposure, in which the start is forgotten."""
    rate, delay_s = 1e5, 1e-6
    for p in (0.3, 0.6):
        traps = Afterpulsing(mean_carriers=p, delay_s=delay_s)
        exposure = 1e8 * delay_s
        for name, is_stationary in (("live", False), ("running", True)):
            stated = afterpulsing.moments(rate, exposure, traps, is_stationary)
            for quantity, power, found in zip(("mean", "variance"), (1, 3), stated, strict=True):
                expected = rate * exposure / (1 - p) ** power
                yield exact_row(
                    "afterpulsing, stated",
                    f"{quantity} of many counts, p {p:g}, {name}",
                    expected,
                    float(found),
                    _RELATIVE_ERROR * expected,
                )


def check_delayed_afterpulsing() -> Iterator[Row]:
    """Exposures of a few delays T: the self-exciting process of Hawkes, Biometrika 58, 83 (1971).

    The rate from a live start is r·(1 − p·e^(−(1−p)·T))/(1 − p); after long running, counts at a
    distance u have the covariance Λ·p·(2 − p)/(2·(1 − p))·e^(−(1−p)·u), Λ = r/(1 − p).
    """
    rate, delay_s = 1e5, 1e-6
    for p in (0.1, 0.5):
        traps = Afterpulsing(mean_carriers=p, delay_s=delay_s)
        for delays in (0.5, 3.0):
            q, steady = 1 - p, rate * delay_s / (1 - p)
            gone = -np.expm1(-q * delays)
            live = steady * (delays - p / q * gone)
            together = steady * p * (2 - p) / (2 * q) * (delays - gone / q) / q
            for quantity, expected, is_stationary, which in (
                ("mean, live", live, False, 0),
                ("mean, running", steady * delays, True, 0),
                ("variance, running", steady * delays + 2 * together, True, 1),
            ):
                found = afterpulsing.moments(rate, delays * delay_s, traps, is_stationary)[which]
                yield exact_row(
                    "afterpulsing, stated",
                    f"{quantity}, p {p:g}, T of {delays:g} delays",
                    expected,
                    float(found),
                    _RELATIVE_ERROR * expected,
                )


def check_tabulated_mean() -> Iterator[Row]:
    """Means from tables, half way between their nodes, where late carriers are as more light.

    With delays of many dead times τ the counts n per second obey n = x/(1 + x·τ), x = r + p·n. What
    varies about that is 0.1 %, and the tables of one decade together are off by no more.

    Between nodes the ratio to the moments without carriers is the cubic through four of them.
    """
    p, dead_s, dead_times = 0.3, 1e-6, 1000.0
    effects = AvalancheEffects(
        dead_time=DeadTime(kind="nonparalyzable", dead_time_s=dead_s, start="stationary"),
        afterpulsing=Afterpulsing(mean_carriers=p, delay_s=50 * dead_s),
    )
    arrivals = 10 ** (2.5 + (np.arange(8) + 0.5) / NODES_PER_DECADE)
    a = arrivals / dead_times
    # x·τ solves y² + (1 − a − p)·y − a = 0
    half = (a + p - 1) / 2
    y = half + np.sqrt(half**2 + a)
    exposure_s = dead_times * dead_s
    mean, _ = count_moments(arrivals[None] / exposure_s, exposure_s, effects)
    ratio = float((mean[0] / (dead_times * y / (1 + y))).mean())
    yield exact_row("afterpulsing, dead time", "mean of a decade over theory", 1.0, ratio, 0.005)
    nodes = 10 ** (2.5 + np.arange(-1, 10) / NODES_PER_DECADE)
    at_nodes, between = (
        _ratios(each / exposure_s, exposure_s, effects) for each in (nodes, arrivals)
    )
    for quantity, known, found in zip(("mean", "variance"), at_nodes, between, strict=True):
        cubics = [
            np.polyval(np.polyfit(np.arange(-1, 3), known[k : k + 4], 3), 0.5) for k in range(8)
        ]
        off = float(np.abs(found / cubics - 1).max())
        yield exact_row("afterpulsing, dead time", f"{quantity} between nodes", 0.0, off, 1e-9)


def _ratios(rate_hz: Floats, exposure_s: float, effects: AvalancheEffects) -> list[Floats]:
    """Mean and variance (n,) over those without carriers."""
    plain = AvalancheEffects(dead_time=effects.dead_time)
    with_carriers, without = (
        count_moments(rate_hz[None], exposure_s, each) for each in (effects, plain)
    )
    return [one[0] / other[0] for one, other in zip(with_carriers, without, strict=True)]
