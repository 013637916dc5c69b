"""How far the law of drawn counts is from that of `brute_force`: total variation distance.

`python -m megalopta.sensor.selfcheck.distances` goes through the kinds of dead time, live and
stationary start, with and without afterpulsing, r·τ of 0.01, 0.1, 1 and 5 and mean counts of 1, 30
and 300, with a million exposures or more at each point. It takes all cores, for some three hours of
processor time; `--all` adds the four points with 45 000 arrivals an exposure (paralyzable,
r·τ = 5, 300 counts), which are six times as many in all.

Two samples of one law differ by chance. Of n and m exposures with standard deviation σ, the
distance of the histograms is then on average near

    Σ_k √(p_k·(1/n + 1/m)/(2π)) ≈ 0.893·√(σ·(1/n + 1/m))          (normal law)

5.3e-3 for 300 Poisson counts and 10⁶ exposures. n is chosen to keep this at 2.3e-3, m = n or, where
no afterpulsing makes drawing slow, 4n. The distance of histograms is never smaller on average than
that of the laws, by the triangle inequality, so that one below 3e-3 shows the laws to be as close,
whatever their shape; no smoothing or correction enters. Beside it stand the chance level and the
excess over it with its standard error, 0.30·√(1/n + 1/m).

Measured at all 144 points: at most 2.73e-3 (ideal), 2.97e-3 (non-paralyzable) and 2.57e-3
(paralyzable), with afterpulsing 2.79e-3, 2.78e-3 and 2.69e-3; no excess beyond 2.7 standard errors,
means and variances within |z| = 2.9.
"""

import argparse
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product

import numpy as np

from megalopta.sensor.avalanches import count_moments, draw_counts
from megalopta.sensor.effects import Afterpulsing, AvalancheEffects
from megalopta.sensor.sampling import generator
from megalopta.sensor.selfcheck.brute_force import brute_force_counts, run_up_s
from megalopta.sensor.selfcheck.comparison import Counts, two_sample_z
from megalopta.sensor.selfcheck.counting import (
    AFTERPULSING,
    MEAN_COUNTS,
    RATE_TIMES_DEAD_TIME,
    Kind,
    Start,
    effects_of,
    operating_point,
)

CHANCE_LEVEL = 2.3e-3
FEWEST_EXPOSURES = 1_000_000
_MOST_ARRIVALS = 3e10
_BLOCK = 50_000


@dataclass(frozen=True)
class Point:
    """One point of the grid."""

    kind: Kind
    start: Start
    has_afterpulsing: bool
    rate_times_dead_time: float
    mean_counts: float

    @property
    def effects(self) -> AvalancheEffects:
        """Dead time and traps."""
        traps = AFTERPULSING if self.has_afterpulsing else Afterpulsing()
        return effects_of(self.kind, self.start, traps)

    @property
    def rate_and_exposure(self) -> tuple[float, float]:
        """Rate of arrivals, Hz, and exposure, s."""
        return operating_point(self.kind, self.rate_times_dead_time, self.mean_counts)

    @property
    def drawn_per_exposure(self) -> int:
        """Exposures drawn for each that is simulated by brute force."""
        return 1 if self.has_afterpulsing else 4

    @property
    def exposures(self) -> int:
        """Exposures by brute force, in whole blocks, that bring chance down to `CHANCE_LEVEL`."""
        rate, exposure = self.rate_and_exposure
        _, variance = count_moments(np.array([[rate]]), exposure, self.effects)
        both = 1 + 1 / self.drawn_per_exposure
        enough = 0.893**2 * float(variance[0, 0]) ** 0.5 * both / CHANCE_LEVEL**2
        return -(-max(int(enough), FEWEST_EXPOSURES) // _BLOCK) * _BLOCK

    @property
    def arrivals(self) -> float:
        """Photons to be simulated by brute force."""
        rate, exposure = self.rate_and_exposure
        return rate * (exposure + run_up_s(self.effects)) * self.exposures


@dataclass(frozen=True)
class Distance:
    """How two samples of counts differ."""

    measured: float
    by_chance: float
    error: float
    mean_z: float
    variance_z: float


_KINDS: tuple[Kind, ...] = ("ideal", "nonparalyzable", "paralyzable")
_STARTS: tuple[Start, ...] = ("live", "stationary")
GRID = tuple(
    Point(*point)
    for point in product(_KINDS, _STARTS, (False, True), RATE_TIMES_DEAD_TIME, MEAN_COUNTS)
)


def measure(point: Point) -> Distance:
    """Compare `point.exposures` exposures, in blocks with streams of their own."""
    rate, exposure = point.rate_and_exposure
    effects, name = point.effects, str(point)
    blocks = point.exposures // _BLOCK

    def simulated(block: int) -> Counts:
        rng = generator(1, "brute force", name, block)
        return np.bincount(brute_force_counts(rng, rate, exposure, effects, _BLOCK))

    def drawn(block: int) -> Counts:
        rates = np.full((_BLOCK, 1), rate)
        return np.bincount(
            draw_counts(generator(2, "drawn", name, block), rates, exposure, effects).ravel()
        )

    return compare(
        _sum_of_blocks(simulated, blocks), _sum_of_blocks(drawn, blocks * point.drawn_per_exposure)
    )


def compare(first: Counts, second: Counts) -> Distance:
    """Compare two histograms of counts."""
    size = max(first.size, second.size)
    first, second = (np.pad(histogram, (0, size - histogram.size)) for histogram in (first, second))
    exposures = first.sum(), second.sum()
    inverse = 1 / exposures[0] + 1 / exposures[1]
    mixed = (first + second) / sum(exposures)
    samples = (np.repeat(np.arange(size), histogram) for histogram in (first, second))
    mean_z, variance_z, _ = two_sample_z(*samples)
    return Distance(
        float(np.abs(first / exposures[0] - second / exposures[1]).sum() / 2),
        float(np.sqrt(mixed * (1 - mixed) * inverse / (2 * np.pi)).sum()),
        float(0.30 * inverse**0.5),
        mean_z,
        variance_z,
    )


def _sum_of_blocks(histogram: Callable[[int], Counts], blocks: int) -> Counts:
    total = np.zeros(1, np.int64)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for part in pool.map(histogram, range(blocks)):
            size = max(total.size, part.size)
            total = np.pad(total, (0, size - total.size)) + np.pad(part, (0, size - part.size))
    return total


def print_distances(points: tuple[Point, ...]) -> None:
    """Measure at all points, a line for each, and print the largest distance of each kind."""
    largest: dict[str, float] = {}
    brute_force_counts(generator(0), 1.0, 1.0, points[0].effects, 1)  # compiled before the clock
    start, whole, done = time.monotonic(), sum(point.arrivals for point in points), 0.0
    for point in points:
        distance = measure(point)
        name = point.kind + (", afterpulsing" if point.has_afterpulsing else "")
        largest[name] = max(largest.get(name, 0.0), distance.measured)
        done += point.arrivals
        left_s = (time.monotonic() - start) * (whole / done - 1)
        print(
            f"{name:29}{point.start:11}r·τ {point.rate_times_dead_time:<5g}"
            f"{point.mean_counts:3g} counts{point.exposures / 1e6:6.2f} M exposures"
            f"  distance {distance.measured:.2e}  by chance {distance.by_chance:.2e}"
            f"  excess {distance.measured - distance.by_chance:+.0e} ± {distance.error:.0e}"
            f"  z of mean {distance.mean_z:+.1f}, variance {distance.variance_z:+.1f}"
            f"  ({left_s / 60:.0f} min left)",
            flush=True,
        )
    for name, value in largest.items():
        print(f"largest distance, {name}: {value:.2e}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Total variation distance to brute force.")
    parser.add_argument("--all", action="store_true", help="also the points that take an hour")
    everything = parser.parse_args().all
    print_distances(tuple(p for p in GRID if everything or p.arrivals < _MOST_ARRIVALS))
