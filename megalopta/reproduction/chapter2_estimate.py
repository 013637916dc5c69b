"""Numbers with their standard errors."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

import numpy as np

from megalopta.core.arrays import Floats


class WithError(NamedTuple):
    """A number and its standard error."""

    value: float
    error: float

    @classmethod
    def of(cls, samples: Floats) -> Self:
        """The mean of independent samples (n,)."""
        return cls(float(samples.mean()), float(samples.std(ddof=1) / np.sqrt(len(samples))))

    @classmethod
    def mean(cls, estimates: Sequence["WithError"]) -> Self:
        """The mean of independent estimates."""
        values, errors = np.array(estimates).T
        return cls(float(values.mean()), float(np.hypot.reduce(errors) / len(errors)))

    @property
    def errors_off(self) -> float:
        """Distance from 0 in standard errors."""
        return self.value / self.error

    def __sub__(self, other: "WithError") -> "WithError":
        """Return the difference of independent estimates."""
        return WithError(self.value - other.value, float(np.hypot(self.error, other.error)))

    def __str__(self) -> str:
        """Return both with the digits that the error leaves, two of its own."""
        digits = self._digits()
        return f"{self.value:.{digits}f} ± {self.error:.{digits}f}"

    def as_difference(self) -> str:
        """Return both with a sign, and how many errors it is from 0."""
        digits = self._digits()
        return f"{self.value:+.{digits}f} ± {self.error:.{digits}f} ({self.errors_off:+.1f})"

    def _digits(self) -> int:
        return max(0, 1 - int(np.floor(np.log10(self.error)))) if self.error > 0 else 2


def jackknifed(statistic: Callable[[Floats], float], samples: Floats) -> WithError:
    """A statistic of independent samples (n, …) with its error by the jackknife (Efron 1982)."""
    without = [statistic(np.delete(samples, left, axis=0)) for left in range(len(samples))]
    # Each has lost an n-th of the data, and with it (n − 1)/√n of a standard deviation of means.
    error = np.std(without) * np.sqrt(len(samples) - 1)
    return WithError(statistic(samples), float(error))
