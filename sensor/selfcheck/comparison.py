"""Every effect of a SPAD array held against its closed form or a plain event simulation.

Streams are fixed, so the result is always the same; a change of the code that is right draws other
numbers. Each comparison then fails with probability 6e-7 (|z| >= 5). A row may be the worst of
several comparisons; `false_alarm` counts them all.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from megalopta.core.arrays import Floats

LARGEST_Z = 5.0

Counts = NDArray[np.int64]


@dataclass(frozen=True)
class Row:
    """One comparison, or the worst of several.

    Attributes
    ----------
    term : str
        The effect.
    quantity : str
        What is compared, with unit.
    expected, measured : float
    z : float
        Difference in standard errors; where nothing is random, in tolerances times 5.
    comparisons : int
        Of how many comparisons this is the worst.
    """

    term: str
    quantity: str
    expected: float
    measured: float
    z: float
    comparisons: int = 1

    @property
    def passed(self) -> bool:
        """Whether the difference can be chance."""
        return abs(self.z) < LARGEST_Z


Check = Callable[[], Iterator[Row]]


def run_checks(checks: tuple[Check, ...], threads: int = 2) -> list[Row]:
    """Run checks in threads and return their rows in the order of the checks."""
    with ThreadPoolExecutor(threads) as pool:
        return [row for rows in pool.map(lambda check: list(check()), checks) for row in rows]


def false_alarm(rows: Sequence[Row]) -> float:
    """Probability, at most, that a right program fails any of the comparisons behind the rows."""
    return float(2 * norm.sf(LARGEST_Z) * sum(row.comparisons for row in rows))


def worst(rows: Sequence[Row]) -> Row:
    """Row farthest off, which stands for all of them."""
    largest = max(rows, key=lambda row: abs(row.z))
    return replace(largest, comparisons=sum(row.comparisons for row in rows))


def worst_of_each(rows: Iterable[Sequence[Row]]) -> Iterator[Row]:
    """Of the same quantities compared at several places, the worst row of each quantity."""
    return (worst(kind) for kind in zip(*rows, strict=True))


def mean_row(term: str, quantity: str, expected: float, sample: Floats | Counts) -> Row:
    """Compare the mean of independent draws with a number."""
    error = float(sample.std()) / sample.size**0.5
    return Row(term, quantity, expected, float(sample.mean()), _z(sample.mean() - expected, error))


def variance_row(term: str, quantity: str, expected: float, sample: Floats | Counts) -> Row:
    """Compare the variance of independent draws with a number."""
    squares = (sample - sample.mean()) ** 2
    error = float(squares.std()) / sample.size**0.5
    return Row(
        term, quantity, expected, float(squares.mean()), _z(squares.mean() - expected, error)
    )


def exact_row(term: str, quantity: str, expected: float, measured: float, tolerance: float) -> Row:
    """Compare two numbers that should agree to within a tolerance."""
    z = LARGEST_Z * (measured - expected) / tolerance
    return Row(term, quantity, expected, measured, float(z))


def two_sample_z(first: Counts, second: Counts) -> tuple[float, float, float]:
    """Z of the difference in mean, in variance and in law of two samples of counts."""
    n, m = first.size, second.size
    deviations = [(sample - sample.mean()) ** 2 for sample in (first, second)]
    mean_error = (first.var() / n + second.var() / m) ** 0.5
    variance_error = (deviations[0].var() / n + deviations[1].var() / m) ** 0.5
    return (
        _z(second.mean() - first.mean(), mean_error),
        _z(deviations[1].mean() - deviations[0].mean(), variance_error),
        law_z(first, second),
    )


def z_rows(term: str, first: Counts, second: Counts, of: str = "") -> Iterator[Row]:
    """Compare mean, variance and law of two samples of counts, by nothing but their z."""
    for quantity, z in zip(("mean", "variance", "law"), two_sample_z(first, second), strict=True):
        yield Row(term, f"{quantity}{of}, as z", 0.0, z, z)


def law_z(first: Counts, second: Counts) -> float:
    """Pearson's test of homogeneity, bins of 20 or more, as the z of the same probability."""
    size = int(max(first.max(), second.max())) + 1
    table = np.array([np.bincount(sample, minlength=size) for sample in (first, second)])
    # neighboring counts share a bin until it holds enough
    bins = (np.cumsum(table.sum(0)) - table.sum(0)) // 40
    table = np.array([np.bincount(bins, row) for row in table])
    table = table[:, table.sum(0) >= 20]
    if table.shape[1] < 2:
        return 0.0
    expected = table.sum(1, keepdims=True) * table.sum(0) / table.sum()
    statistic = ((table - expected) ** 2 / expected).sum()
    return float(norm.isf(max(chi2.sf(statistic, table.shape[1] - 1), 1e-300)))


def _z(difference: float, error: float) -> float:
    if error == 0:
        return 0.0 if difference == 0 else np.inf
    return float(difference / error)
