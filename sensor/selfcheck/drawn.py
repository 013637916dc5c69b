"""Many draws of counts against their law, where brute force takes too long.

non-paralyzable     P(N >= n) = P(n, r·(T − (n − 1)·τ)), the incomplete gamma function, from a live
                    start
paralyzable         E[N·(N − 1)·(N − 2)] = (q·(x − 2a))³ after long running, q = e^(−a)
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.special import gammainc
from scipy.stats import chi2, norm, poisson

from megalopta.core.arrays import Floats
from megalopta.sensor.avalanches import draw_counts
from megalopta.sensor.effects import (
    AvalancheEffects,
    AvalancheMaps,
    Crosstalk,
    DeadTime,
    dead_time,
    paralyzable,
)
from megalopta.sensor.sampling import generator, quantile
from megalopta.sensor.selfcheck.comparison import (
    Counts,
    Row,
    exact_row,
    mean_row,
    variance_row,
    worst_of_each,
)

_TAU_S = 1e-6
_SHAPE = 500, 800


def check_drawn_dead_time() -> Iterator[Row]:
    """Mean and variance of a few and of hundreds of counts, live at the start and running."""
    for kind, start in product(("nonparalyzable", "paralyzable"), ("live", "stationary")):
        dead = DeadTime.model_validate({"kind": kind, "dead_time_s": _TAU_S, "start": start})
        term = f"{kind} dead time, {start}"
        yield from worst_of_each(_moment_rows(term, dead, *at) for at in _POINTS[kind])
    dead = DeadTime(kind="nonparalyzable", dead_time_s=_TAU_S)
    for a, counts in _POINTS["nonparalyzable"]:
        z = _law_z(_drawn("law", dead, a, counts), counts * (1 + a), a)
        yield Row(f"{dead.kind} dead time", f"law, r·τ {a:g}, {counts:g}", 0.0, z, z)


# r·τ, counts that would be without what happens at the start
_POINTS = {
    "nonparalyzable": ((0.3, 8.0), (0.3, 300.0), (2.0, 60.0)),
    "paralyzable": ((0.05, 8.0), (0.3, 20.0), (2.0, 5.0), (0.3, 120.0)),
}


def check_skewness() -> Iterator[Row]:
    """Hundreds of paralyzable counts, drawn as a skewed normal law: its third cumulant."""
    z = np.linspace(-8, 8, 40_001)
    weights = np.exp(-(z**2) / 2) / np.exp(-(z**2) / 2).sum()
    for counts, a in ((101.0, 0.02), (150.0, 0.1), (300.0, 0.2)):
        q, x = np.exp(-a), counts * np.exp(a)
        once, twice, thrice = ((q * (x - k * a)) ** (k + 1) for k in range(3))
        square, cube = twice + once, thrice + 3 * twice + once
        expected = cube - 3 * square * once + 2 * once**3
        law = once, square - once**2
        drawn = np.array([paralyzable.approximate_count(each, *law, a) for each in z])
        found = float(weights @ (drawn - weights @ drawn) ** 3)
        quantity = f"third cumulant, r·τ {a:g}, {counts:g} counts"
        # the law for long exposures, and numbers rounded to counts
        yield exact_row("paralyzable dead time", quantity, expected, found, 2e-3 * expected)


def check_poisson_quantiles() -> Iterator[Row]:
    """Poisson counts, drawn as quantiles of normal numbers: where they step, and their chances."""
    for mean in (5.3, 40.0, 3000.0):
        z = norm.ppf((np.arange(400_000) + 0.5) / 400_000)
        counts = np.empty_like(z)
        quantile.fill_quantiles(z, np.full(z.size, mean), counts)
        n = np.arange(poisson.ppf(1e-4, mean), poisson.isf(1e-4, mean))
        found = np.searchsorted(counts, n, side="right") / z.size
        # numbers this far apart miss a step by half of a chance of 1 / 400,000 at most
        off = float(np.abs(found - poisson.cdf(n, mean)).max())
        yield exact_row("Poisson", f"largest error of P(N ≤ n), mean {mean:g}", 0.0, off, 1.3e-6)


def check_certain_neighbor() -> Iterator[Row]:
    """A pixel that fires its neighbor at every avalanche, by an ample or a narrow margin."""
    effects = AvalancheEffects(crosstalk=Crosstalk(mean_fired_neighbors=0.8))
    for strength in (5.05, 20.0):  # of a probability of 0.2
        maps = AvalancheMaps.alike((1, 2))._replace(crosstalk=np.array([[strength, 0.0]]))
        sent, fired = draw_counts(generator(43), np.array([[5e3, 0.0]]), 1.0, effects, maps)[0]
        term = f"crosstalk, certain {strength / 5:g} times"
        yield exact_row(term, "counts fired", float(sent), float(fired), 1e-9)


def _moment_rows(term: str, dead: DeadTime, a: float, counts: float) -> tuple[Row, Row]:
    rate, exposure_s = _light(dead, a, counts)
    mean, variance = dead_time.moments([rate], exposure_s, dead)
    drawn, where = _drawn(term, dead, a, counts), f"(worst: r·τ {a:g}, {counts:g} counts)"
    return (
        mean_row(term, f"mean {where}", float(mean[0]), drawn),
        variance_row(term, f"variance {where}", float(variance[0]), drawn),
    )


def _drawn(term: str, dead: DeadTime, a: float, counts: float) -> Counts:
    rate, exposure_s = _light(dead, a, counts)
    effects = AvalancheEffects(dead_time=dead)
    return draw_counts(generator(42, term, str(a)), np.full(_SHAPE, rate), exposure_s, effects)


def _light(dead: DeadTime, a: float, counts: float) -> tuple[float, float]:
    """Rate, Hz, and exposure, s."""
    arrivals = counts * (1 + a if dead.kind == "nonparalyzable" else np.exp(a))
    return a / _TAU_S, arrivals * _TAU_S / a


def _law_z(drawn: Counts, x: float, a: float) -> float:
    """Pearson's test against the exact law, bins of about 40, as the z of its probability."""
    n = np.arange(drawn.max() + 2)
    reached: Floats = gammainc(n[1:], np.maximum(x - (n[1:] - 1) * a, 0.0))
    due = drawn.size * -np.diff(reached, prepend=1.0, append=0.0)
    found = np.bincount(drawn.ravel(), minlength=due.size)
    bins = (np.cumsum(due) // 40).astype(np.int64)
    expected, drawn_of = (np.bincount(bins, each) for each in (due, found))
    enough = expected > 0
    statistic = ((drawn_of - expected)[enough] ** 2 / expected[enough]).sum()
    return float(norm.isf(max(chi2.sf(statistic, enough.sum() - 1), 1e-300)))
