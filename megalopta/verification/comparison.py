"""What is compared of two samples, and the row of a table that it makes.

Streams are fixed, so the result is always the same; a change of the code that is right draws other
numbers. Each comparison then fails with a probability of at most 6e-7 (|z| >= 5). A row is the
worst of several comparisons; `false_alarm` counts them all.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

LARGEST_Z = 5.0

Sample = NDArray[Any]


@dataclass(frozen=True)
class Row:
    """One comparison, or the worst of several."""

    term: str
    """The effect"""
    quantity: str
    """What is compared, with unit"""
    expected: float
    measured: float
    z: float
    """Difference in standard errors; where nothing is random, in tolerances times 5"""
    comparisons: int = 1
    """Of how many comparisons this is the worst"""

    @property
    def passed(self) -> bool:
        """Whether the difference can be chance."""
        return abs(self.z) < LARGEST_Z


Check = Callable[[], Row]


def run_checks(checks: Sequence[Check], threads: int = 2) -> list[Row]:
    """Run checks in threads and return their rows in the order of the checks."""
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda check: check(), checks))


def false_alarm(rows: Sequence[Row]) -> float:
    """Probability, at most, that a right program fails any of the comparisons behind the rows."""
    return float(2 * norm.sf(LARGEST_Z) * sum(row.comparisons for row in rows))


def worst(rows: Sequence[Row]) -> Row:
    """Row farthest off, which stands for all of them."""
    largest = max(rows, key=lambda row: np.inf if np.isnan(row.z) else abs(row.z))
    return replace(largest, comparisons=sum(row.comparisons for row in rows))


def mean_row(term: str, quantity: str, expected: float, sample: Sample, allowed: float = 0) -> Row:
    """Compare the mean of independent draws with a number that may be off by so much itself."""
    mean, error = float(sample.mean()), float(sample.std()) / sample.size**0.5
    return Row(term, quantity, expected, mean, _z(mean - expected, error, allowed))


def variance_row(
    term: str, quantity: str, expected: float, sample: Sample, allowed: float = 0
) -> Row:
    """Compare the variance of independent draws with a number that may be off by so much itself."""
    return mean_row(term, quantity, expected, (sample - sample.mean()) ** 2, allowed)


def exact_row(term: str, quantity: str, expected: float, measured: float, tolerance: float) -> Row:
    """Compare two numbers that should agree to within a tolerance."""
    z = LARGEST_Z * (measured - expected) / tolerance
    return Row(term, quantity, float(expected), float(measured), float(z))


def largest_row(term: str, quantity: str, expected: Any, measured: Any, relative: float) -> Row:
    """Compare arrays of numbers that should agree to within a relative tolerance."""
    pairs = np.broadcast_arrays(expected, measured)
    return worst(
        [
            exact_row(term, quantity, right, got, relative * abs(right))
            for right, got in zip(*(each.ravel() for each in pairs), strict=True)
        ]
    )


def sample_rows(term: str, where: str, plain: Sample, drawn: Sample) -> list[Row]:
    """Compare mean, variance and law of two samples."""
    mean_z, variance_z, law = two_sample_z(plain, drawn)
    return [
        Row(term, f"mean, {where}", float(plain.mean()), float(drawn.mean()), mean_z),
        Row(term, f"variance, {where}", float(plain.var()), float(drawn.var()), variance_z),
        Row(term, f"law as z, {where}", 0.0, law, law),
    ]


def two_sample_z(first: Sample, second: Sample) -> tuple[float, float, float]:
    """Return z of the difference in mean, in variance and in law of two samples (n,) of counts."""
    n, m = first.size, second.size
    deviations = [(sample - sample.mean()) ** 2 for sample in (first, second)]
    mean_error = (first.var() / n + second.var() / m) ** 0.5
    variance_error = (deviations[0].var() / n + deviations[1].var() / m) ** 0.5
    return (
        _z(second.mean() - first.mean(), mean_error),
        _z(deviations[1].mean() - deviations[0].mean(), variance_error),
        law_z(first, second),
    )


def law_z(first: Sample, second: Sample) -> float:
    """Pearson's test of homogeneity, bins of 20 or more, as the z of the same probability."""
    first, second = (np.asarray(sample).astype(np.int64) for sample in (first, second))
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


def _z(difference: float, error: float, allowed: float = 0.0) -> float:
    beyond = max(abs(difference) - allowed, 0.0)
    if error == 0:
        return 0.0 if beyond == 0 else np.inf
    return float(np.copysign(beyond / error, difference))
